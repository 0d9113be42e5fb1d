// SPDX-License-Identifier: Apache-2.0
/// @file Patches of two photos around a pixel and their correlation (PGSR, Chen et al. 2024, Sec. 3.2). T is any type
/// of number (see host_device.h): float on a GPU, a vector of pixels on a CPU.

#if defined(SPLATBOOST_PATCH_MATH_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_PATCH_MATH_H_
#undef SPLATBOOST_PATCH_MATH_H_
#else
#define SPLATBOOST_PATCH_MATH_H_
#endif

#include "device/host_device.h"
#include "geometry/patch_views.h"

SPLATBOOST_MATH_BEGIN

/// A grey value and its derivatives, per pixel.
template <class T>
struct GreySample {
  T value, slope_x, slope_y;
};

/// Samples bilinearly between the centres of pixels; the greys of the border continue outside.
/// @param x,y px
/// @param texel (column, row) ↦ grey; called with integers within the image
template <class T, class Texel>
SPLATBOOST_HOST_DEVICE GreySample<T> sample_grey(T x, T y, int width, int height, const Texel& texel) {
  const T zero(0.0f), half(0.5f), one(1.0f);
  const T last_x(static_cast<float>(width - 1)), last_y(static_cast<float>(height - 1));
  const T shifted_x = x - half, shifted_y = y - half;
  const T in_x = min_of(max_of(shifted_x, zero), last_x), in_y = min_of(max_of(shifted_y, zero), last_y);
  const T x0 = floor_of(in_x), y0 = floor_of(in_y);
  const T x1 = min_of(x0 + one, last_x), y1 = min_of(y0 + one, last_y);
  const T fraction_x = in_x - x0, fraction_y = in_y - y0;
  const T a = texel(x0, y0), b = texel(x1, y0), c = texel(x0, y1), d = texel(x1, y1);
  const T top = a + fraction_x * (b - a), bottom = c + fraction_x * (d - c);
  const T across = (b - a) + fraction_y * ((d - c) - (b - a));
  const T slope_x = select(shifted_x > zero, select(shifted_x < last_x, across, zero), zero);
  const T slope_y = select(shifted_y > zero, select(shifted_y < last_y, bottom - top, zero), zero);
  return {top + fraction_y * (bottom - top), slope_x, slope_y};
}

/// Comparison of a patch of a plane in two photos.
template <class T>
struct PatchMatch {
  T counts;     ///< 1 where both see the patch and agree; otherwise 0, as are the numbers below
  T loss;       ///< 1 − squared correlation
  T normal[3];  ///< gradient of the loss with respect to the blended plane
  T distance;
};

/// @param column,row of the patch's centre in the first photo, integers
/// @param normal,distance the blended plane
/// @param grey_first (column, row) ↦ grey of the first photo, 0 to 1, or NaN where it has none; called with integers
/// within it
/// @param grey_second the same for the second
template <class T, class FirstTexel, class SecondTexel>
SPLATBOOST_HOST_DEVICE PatchMatch<T> match_patch(const PatchViews& views, T column, T row, const T (&normal)[3],
                                                 T distance, const FirstTexel& grey_first,
                                                 const SecondTexel& grey_second) {
  const T zero(0.0f), one(1.0f), least(kMinPatchDepth);
  const T last_column(static_cast<float>(views.width_first - 1)), last_row(static_cast<float>(views.height_first - 1));
  // A point of the plane on the ray r is r / s, s = −n·r / d; in the second view it lies along R·r + s·t: linear in the
  // pixel, as all homographies are.
  const T inverse_distance = one / max_of(distance, least);
  const T ray_x = (column + T(0.5f) - T(views.cx_first)) * T(views.step_x);
  const T ray_y = (row + T(0.5f) - T(views.cy_first)) * T(views.step_y);
  const T s = -((normal[0] * ray_x + normal[1] * ray_y + normal[2]) * inverse_distance);
  const T s_x = -(normal[0] * T(views.step_x) * inverse_distance);
  const T s_y = -(normal[1] * T(views.step_y) * inverse_distance);
  T middle[3], along_x[3], along_y[3];
  for (int k = 0; k < 3; ++k) {
    const T r0(views.rotation[k][0]), r1(views.rotation[k][1]), r2(views.rotation[k][2]), t(views.shift[k]);
    middle[k] = (r0 * ray_x + r1 * ray_y + r2) + s * t;
    along_x[k] = r0 * T(views.step_x) + s_x * t;
    along_y[k] = r1 * T(views.step_y) + s_y * t;
  }
  T firsts[kPatchPixels], seconds[kPatchPixels], slopes[kPatchPixels];
  T sum_a = zero, sum_b = zero, sum_aa = zero, sum_bb = zero, sum_ab = zero;
  T nearest = middle[2];
  int k = 0;
  for (int j = -kPatchRadius; j <= kPatchRadius; ++j) {
    const T dy(static_cast<float>(j)), in_row = min_of(max_of(row + dy, zero), last_row);
    for (int i = -kPatchRadius; i <= kPatchRadius; ++i, ++k) {
      const T dx(static_cast<float>(i)), in_column = min_of(max_of(column + dx, zero), last_column);
      const T z = (middle[2] + dx * along_x[2]) + dy * along_y[2];
      nearest = min_of(nearest, z);
      const T inverse_z = one / max_of(z, least);
      const T u = ((middle[0] + dx * along_x[0]) + dy * along_y[0]) * inverse_z;
      const T v = ((middle[1] + dx * along_x[1]) + dy * along_y[1]) * inverse_z;
      const T fx(views.fx_second), fy(views.fy_second);
      const GreySample<T> found = sample_grey(fx * u + T(views.cx_second), fy * v + T(views.cy_second),
                                              views.width_second, views.height_second, grey_second);
      const T first = grey_first(in_column, in_row);
      firsts[k] = first;
      seconds[k] = found.value;
      // ∂ grey / ∂ s
      slopes[k] = (found.slope_x * fx * (T(views.shift[0]) - u * T(views.shift[2])) +
                   found.slope_y * fy * (T(views.shift[1]) - v * T(views.shift[2]))) *
                  inverse_z;
      sum_a += first;
      sum_b += found.value;
      sum_aa += first * first;
      sum_bb += found.value * found.value;
      sum_ab += first * found.value;
    }
  }
  const T share(1.0f / static_cast<float>(kPatchPixels)), two(2.0f);
  const T mean_a = sum_a * share, mean_b = sum_b * share;
  const T variance_a = sum_aa * share - mean_a * mean_a, variance_b = sum_bb * share - mean_b * mean_b;
  const T covariance = sum_ab * share - mean_a * mean_b;
  const T inverse = one / (variance_a * variance_b + T(1e-8f));
  const T loss = one - covariance * covariance * inverse;
  PatchMatch<T> out;
  out.counts =
      select(distance > least, select(nearest > least, select(loss < T(kMaxPatchLoss), one, zero), zero), zero);
  out.loss = select(out.counts > zero, max_of(loss, zero), zero);
  // No gradient where the loss is clamped.
  const T passes = select(out.loss > zero, inverse, zero);
  const T of_a = -(two * covariance * passes * share);
  const T of_b = two * covariance * covariance * passes * inverse * variance_a * share;
  // Σ g·r over the patch, r linear in the pixel.
  T sum = zero, sum_x = zero, sum_y = zero;
  k = 0;
  for (int j = -kPatchRadius; j <= kPatchRadius; ++j) {
    T in_row = zero;
    for (int i = -kPatchRadius; i <= kPatchRadius; ++i, ++k) {
      const T g = (of_a * (firsts[k] - mean_a) + of_b * (seconds[k] - mean_b)) * slopes[k];
      in_row += g;
      sum_x += g * T(static_cast<float>(i));
    }
    sum += in_row;
    sum_y += in_row * T(static_cast<float>(j));
  }
  const T g_x = sum * ray_x + sum_x * T(views.step_x), g_y = sum * ray_y + sum_y * T(views.step_y);
  // ∂ s / ∂ n = −r / d, ∂ s / ∂ d = n·r / d². select(), because numbers of patches that do not count may be NaN.
  const T scale = select(out.loss > zero, inverse_distance, zero);
  out.normal[0] = select(out.loss > zero, -(scale * g_x), zero);
  out.normal[1] = select(out.loss > zero, -(scale * g_y), zero);
  out.normal[2] = select(out.loss > zero, -(scale * sum), zero);
  out.distance =
      select(out.loss > zero,
             (normal[0] * g_x + normal[1] * g_y + normal[2] * sum) * inverse_distance * inverse_distance, zero);
  return out;
}

SPLATBOOST_MATH_END

#endif  // guard

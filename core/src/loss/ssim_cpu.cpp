// SPDX-License-Identifier: Apache-2.0
#include "splatboost/ssim.h"

#include <algorithm>
#include <vector>

#include "loss/cuda_ops.h"
#include "splatboost/errors.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "loss/ssim_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "device/lanes-inl.h"
#include "loss/photometric_math.h"

#ifndef SPLATBOOST_SSIM_STRIP_
#define SPLATBOOST_SSIM_STRIP_
namespace splatboost {

inline constexpr std::size_t kSsimHalo = kSsimRadius;
/// Rows of a plane that are processed at a time: enough that the cost of the halo above and below is small.
inline constexpr std::size_t kSsimStrip = 64;
/// Floats that a vector at the end of a row may read beyond it.
inline constexpr std::size_t kSsimSlack = kTileSize;

/// Rows [y0, y0 + rows) of a plane, and their outputs.
struct SsimStrip {
  std::size_t width, height;
  const float* image;
  const float* truth;
  float* gradient;  ///< null: value only
  std::size_t y0, rows;
  std::size_t border;  ///< width of the plane's margin without windows, px
  float weight;        ///< d mean / d SSIM of one window
};

}  // namespace splatboost
#endif  // SPLATBOOST_SSIM_STRIP_

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Rows of floats, of which the first is row `first` of a plane; rows above the plane (`first` < 0) are zero.
struct Rows {
  std::ptrdiff_t first;
  std::size_t stride;
  std::vector<float> values;

  Rows(std::ptrdiff_t first_row, std::size_t rows, std::size_t row_stride)
      : first(first_row), stride(row_stride), values(rows * row_stride, 0.0f) {}
  float* row(std::ptrdiff_t y) { return values.data() + static_cast<std::size_t>(y - first) * stride; }
};

/// to[x] = Σ_k window[k]·from[x + k − 5]; from must have five zeros before and after it.
void blur_along_x(const float* from, std::size_t width, float* to) {
  for (std::size_t x = 0; x < width; x += lanes()) {
    const float* centre = from + x;
    Float sum = Float(kSsimWindow[kSsimHalo]) * load(centre);
    for (std::size_t k = 1; k <= kSsimHalo; ++k) {
      sum += Float(kSsimWindow[kSsimHalo - k]) * (load(centre - k) + load(centre + k));
    }
    store(sum, to + x);
  }
}

Float blur_along_y(Rows& rows, std::ptrdiff_t y, std::size_t x) {
  const auto halo = static_cast<std::ptrdiff_t>(kSsimHalo);
  Float sum = Float(kSsimWindow[kSsimHalo]) * load(rows.row(y) + x);
  for (std::ptrdiff_t k = 1; k <= halo; ++k) {
    sum += Float(kSsimWindow[halo - k]) * (load(rows.row(y - k) + x) + load(rows.row(y + k) + x));
  }
  return sum;
}

double ssim_strip(const SsimStrip& strip) {
  const auto halo = static_cast<std::ptrdiff_t>(kSsimHalo);
  const auto y0 = static_cast<std::ptrdiff_t>(strip.y0), rows = static_cast<std::ptrdiff_t>(strip.rows);
  const auto height = static_cast<std::ptrdiff_t>(strip.height);
  const std::size_t width = strip.width, stride = width + kSsimSlack;
  const bool wants_gradient = strip.gradient != nullptr;
  // The gradient of a row needs the derivatives of windows up to five rows away, which need the pixels of five more.
  const std::ptrdiff_t reach = wants_gradient ? halo : 0;
  const auto map_rows = static_cast<std::size_t>(rows + 2 * reach);

  Rows means(y0 - reach - halo, map_rows + 2 * kSsimHalo, stride);
  Rows truth_means = means, squares = means, products = means;
  std::vector<float> padded[4];
  for (std::vector<float>& p : padded) p.assign(width + 2 * kSsimHalo + kSsimSlack, 0.0f);
  for (std::ptrdiff_t y = std::max<std::ptrdiff_t>(0, means.first); y < std::min(height, y0 + rows + reach + halo);
       ++y) {
    const float* image = strip.image + static_cast<std::size_t>(y) * width;
    const float* truth = strip.truth + static_cast<std::size_t>(y) * width;
    for (std::size_t x = 0; x < width; ++x) {
      const float a = image[x], b = truth[x];
      padded[0][kSsimHalo + x] = a;
      padded[1][kSsimHalo + x] = b;
      padded[2][kSsimHalo + x] = a * a + b * b;
      padded[3][kSsimHalo + x] = a * b;
    }
    blur_along_x(padded[0].data() + kSsimHalo, width, means.row(y));
    blur_along_x(padded[1].data() + kSsimHalo, width, truth_means.row(y));
    blur_along_x(padded[2].data() + kSsimHalo, width, squares.row(y));
    blur_along_x(padded[3].data() + kSsimHalo, width, products.row(y));
  }

  double sum = 0;
  const auto border = static_cast<std::ptrdiff_t>(strip.border);
  Rows of_means(y0 - reach, map_rows, stride);
  Rows of_squares = of_means, of_products = of_means;
  std::vector<float> values(stride);
  const std::size_t left = strip.border, right = width - strip.border;
  for (std::ptrdiff_t y = std::max(border, y0 - reach); y < std::min(height - border, y0 + rows + reach); ++y) {
    for (std::size_t x = 0; x < width; x += lanes()) {
      const SsimPixel<Float> s = ssim_pixel(blur_along_y(means, y, x), blur_along_y(truth_means, y, x),
                                            blur_along_y(squares, y, x), blur_along_y(products, y, x));
      store(s.value, values.data() + x);
      store(s.d_mean, padded[0].data() + kSsimHalo + x);
      store(s.d_square, padded[1].data() + kSsimHalo + x);
      store(s.d_product, padded[2].data() + kSsimHalo + x);
    }
    if (y >= y0 && y < y0 + rows) {
      for (std::size_t x = left; x < right; ++x) sum += static_cast<double>(values[x]);
    }
    if (!wants_gradient) continue;
    for (std::vector<float>& p : padded) {  // no windows in the margin
      std::fill(p.begin(), p.begin() + static_cast<std::ptrdiff_t>(kSsimHalo + left), 0.0f);
      std::fill(p.begin() + static_cast<std::ptrdiff_t>(kSsimHalo + right), p.end(), 0.0f);
    }
    blur_along_x(padded[0].data() + kSsimHalo, width, of_means.row(y));
    blur_along_x(padded[1].data() + kSsimHalo, width, of_squares.row(y));
    blur_along_x(padded[2].data() + kSsimHalo, width, of_products.row(y));
  }
  if (!wants_gradient) return sum;

  const Float weight(strip.weight), two(2.0f);
  std::vector<float> image(stride), truth(stride);
  for (std::ptrdiff_t y = y0; y < y0 + rows; ++y) {
    const std::size_t at = static_cast<std::size_t>(y) * width;
    std::copy_n(strip.image + at, width, image.data());
    std::copy_n(strip.truth + at, width, truth.data());
    for (std::size_t x = 0; x < width; x += lanes()) {
      // Derivatives of the windows around the pixel: the window is its own adjoint.
      Float g[3];
      Rows* maps[3] = {&of_means, &of_squares, &of_products};
      for (int m = 0; m < 3; ++m) g[m] = blur_along_y(*maps[m], y, x);
      store(weight * (g[0] + two * load(image.data() + x) * g[1] + load(truth.data() + x) * g[2]), values.data() + x);
    }
    std::copy_n(values.data(), width, strip.gradient + at);
  }
  return sum;
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(ssim_strip);

/// Checks the shapes. @return width of the planes' margin without windows, px
int checked_border(const SsimPlanes& planes, std::span<const float> images, std::span<const float> truths,
                   SsimPadding padding, std::span<const float> gradient) {
  SPLATBOOST_CHECK(planes.count > 0 && planes.width > 0 && planes.height > 0,
                   "ssim needs at least one plane of at least one pixel");
  const auto width = static_cast<std::size_t>(planes.width), height = static_cast<std::size_t>(planes.height);
  const std::size_t size = planes.count * width * height;
  SPLATBOOST_CHECK(images.size() == size && truths.size() == size, "images and truths must be [count,H,W]");
  SPLATBOOST_CHECK(gradient.empty() || gradient.size() == size, "gradient must be empty or [count,H,W]");
  const int border = padding == SsimPadding::valid ? kSsimRadius : 0;
  SPLATBOOST_CHECK(planes.width > 2 * border && planes.height > 2 * border,
                   "an image of width or height below 11 contains no window: use padding \"same\"");
  return border;
}
}  // namespace

void ssim(const SsimPlanes& planes, std::span<const float> images, std::span<const float> truths, SsimPadding padding,
          std::span<float> gradient, std::span<double> mean, CudaSsimWorkspace& workspace) {
  const int border = checked_border(planes, images, truths, padding, gradient);
  SPLATBOOST_CHECK(planes.count <= 65535, "at most 65 535 planes on a CUDA device");
  SPLATBOOST_CHECK(mean.size() == 1, "mean must be one number");
  cuda::ssim(planes, images, truths, border, gradient, mean, workspace);
}

double ssim(const SsimPlanes& planes, std::span<const float> images, std::span<const float> truths, SsimPadding padding,
            std::span<float> gradient, const Threads& threads) {
  const auto border = static_cast<std::size_t>(checked_border(planes, images, truths, padding, gradient));
  const auto width = static_cast<std::size_t>(planes.width), height = static_cast<std::size_t>(planes.height);
  const std::size_t pixels = width * height;
  const double windows =
      static_cast<double>(planes.count) * static_cast<double>((width - 2 * border) * (height - 2 * border));

  const std::size_t strips = (height + kSsimStrip - 1) / kSsimStrip;
  std::vector<double> sums(planes.count * strips);
  threads.for_range(sums.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t plane = i / strips, y0 = i % strips * kSsimStrip;
      SsimStrip strip;
      strip.width = width;
      strip.height = height;
      strip.image = images.data() + plane * pixels;
      strip.truth = truths.data() + plane * pixels;
      strip.gradient = gradient.empty() ? nullptr : gradient.data() + plane * pixels;
      strip.y0 = y0;
      strip.rows = std::min(kSsimStrip, height - y0);
      strip.border = border;
      strip.weight = static_cast<float>(1.0 / windows);
      sums[i] = HWY_DYNAMIC_DISPATCH(ssim_strip)(strip);
    }
  });
  double sum = 0;
  for (const double s : sums) sum += s;
  return sum / windows;
}

}  // namespace splatboost
#endif  // HWY_ONCE

// SPDX-License-Identifier: Apache-2.0
#include "blend_cuda.h"
#include "launch.h"

namespace splatboost::cuda {
namespace {

/// Adds what lanes 2·kHalf apart hold of 2·kHalf values; each keeps the half that its number says.
template <int kHalf>
__device__ inline void fold(float (&values)[kMomentColumns]) {
  const bool upper = (threadIdx.x & (2u * kHalf)) != 0;
#pragma unroll
  for (int i = 0; i < kHalf; ++i) {
    const float given = upper ? values[i] : values[i + kHalf];
    const float kept = upper ? values[i + kHalf] : values[i];
    values[i] = kept + __shfl_xor_sync(kWholeWarp, given, 2 * kHalf);
  }
}

/// Sums of 16 values over a whole warp, in 16 shuffles instead of 80: lane l gets the sum of value l / 2.
__device__ inline float warp_sums(float (&values)[kMomentColumns]) {
  static_assert(kMomentColumns == 16);
  fold<8>(values);
  fold<4>(values);
  fold<2>(values);
  fold<1>(values);
  return values[0] + __shfl_xor_sync(kWholeWarp, values[0], 1);
}

/// Adds a warp's sums to a row of memory.
__device__ inline void add_row(DeviceView<float> rows, std::size_t first, int columns,
                               float (&values)[kMomentColumns]) {
  const float sum = warp_sums(values);
  const int column = static_cast<int>(threadIdx.x % 32) / 2;
  if (threadIdx.x % 2 == 0 && column < columns) atomicAdd(&rows[first + column], sum);
}

struct BlendGradients {
  DeviceView<const float> pixels;  ///< [4 + X, H, W] what blending made
  DeviceView<const float> color, alpha, features, inverse_depth;
  DeviceView<const float> channels;
  int extra;  ///< X
  int features_count;
  DeviceView<float> moments;            ///< [N, kMomentColumns]
  DeviceView<float> feature_gradients;  ///< [N, features]
};

/// A thread a pixel, front to back with the transmittance recomputed; a warp adds to a splat once.
/// @tparam kMostExtra room for that many extra channels
template <bool kAbsolute, int kMostExtra>
__global__ void __launch_bounds__(kTilePixels) blend_backward_kernel(TileLists lists, BlendGradients in) {
  const TilePixel pixel(lists, blockIdx.x);
  bool open = pixel.inside;
  float transmittance = 1.0f;
  const std::size_t plane = static_cast<std::size_t>(lists.width) * lists.height, at = pixel.index(lists);
  const auto upstream = [&](const DeviceView<const float>& image, int c) {
    return pixel.inside && !image.empty() ? image[c * plane + at] : 0.0f;
  };
  const auto blended = [&](int c) { return pixel.inside ? in.pixels[c * plane + at] : 0.0f; };
  const float g_red = upstream(in.color, 0), g_green = upstream(in.color, 1), g_blue = upstream(in.color, 2);
  const float g_alpha = upstream(in.alpha, 0);
  float g_extra[kMostExtra > 0 ? kMostExtra : 1] = {};
  // Gradient · what the splats behind the current one, and the background, add to the image.
  float rest = g_red * blended(0) + g_green * blended(1) + g_blue * blended(2) + g_alpha * blended(3);
#pragma unroll
  for (int c = 0; c < kMostExtra; ++c) {
    if (c >= in.extra) continue;
    g_extra[c] = c < in.features_count ? upstream(in.features, c) : upstream(in.inverse_depth, 0);
    rest = fmaf(g_extra[c], blended(4 + c), rest);
  }

  visit_splats(lists, blockIdx.x, pixel, open, [&](std::uint32_t gaussian, const SplatRecord& splat) {
    const PixelStep step = step_pixel(splat, pixel, transmittance, open);
    if (!__any_sync(kWholeWarp, step.blended)) return;
    float moments[kMomentColumns] = {};
    float features[kMomentColumns] = {};
    if (step.blended) {
      const float weight = transmittance * step.alpha;
      float along = g_alpha;  // gradient · the splat's own channels; alpha is one that is 1
      along = fmaf(g_red, splat.red, along);
      along = fmaf(g_green, splat.green, along);
      along = fmaf(g_blue, splat.blue, along);
#pragma unroll
      for (int c = 0; c < kMostExtra; ++c) {
        if (c >= in.extra) continue;
        along = fmaf(g_extra[c], in.channels[gaussian * static_cast<std::size_t>(in.extra) + c], along);
        if (c < in.features_count) {
          features[c] = weight * g_extra[c];
        } else {
          moments[kMomentInverseDepth] = weight * g_extra[c];
        }
      }
      const float gain = weight * along;
      rest -= gain;
      // s = α·dL/dα = weight·along − rest·α/(1 − α), and α/(1 − α) = weight/after.
      const float s = step.alpha < kMaxAlpha ? gain - rest * (weight / step.after) : 0.0f;
      transmittance = step.after;
      const float sx = s * step.dx, sy = s * step.dy;
      moments[kMomentS] = s;
      moments[kMomentSX] = sx;
      moments[kMomentSY] = sy;
      moments[kMomentSXX] = sx * step.dx;
      moments[kMomentSXY] = sx * step.dy;
      moments[kMomentSYY] = sy * step.dy;
      moments[kMomentRed] = weight * g_red;
      moments[kMomentGreen] = weight * g_green;
      moments[kMomentBlue] = weight * g_blue;
      if (kAbsolute) {
        const float slope_x = fmaf(2.0f * splat.quadratic_xx, step.dx, splat.quadratic_xy * step.dy);
        const float slope_y = fmaf(2.0f * splat.quadratic_yy, step.dy, splat.quadratic_xy * step.dx);
        moments[kMomentAbsX] = fabsf(s * slope_x);
        moments[kMomentAbsY] = fabsf(s * slope_y);
      }
    }
    add_row(in.moments, gaussian * static_cast<std::size_t>(kMomentColumns), kMoments, moments);
    if (kMostExtra > 0 && in.features_count > 0) {
      add_row(in.feature_gradients, gaussian * static_cast<std::size_t>(in.features_count), in.features_count,
              features);
    }
  });
}

}  // namespace

void blend_backward(CudaFrame& frame, const RasterImageGradients& gradients, bool absolute, CudaStream& stream) {
  frame.moments.ensure(frame.gaussians * kMomentColumns);
  frame.moments.fill_zero();
  frame.feature_gradients.ensure(frame.gaussians * static_cast<std::size_t>(frame.features));
  frame.feature_gradients.fill_zero();
  const bool extra_gradients =
      (!gradients.features.empty() && frame.features > 0) || (!gradients.inverse_depth.empty() && frame.inverse_depth);
  const BlendGradients in{std::as_const(frame.pixels).span(),
                          gradients.color,
                          gradients.alpha,
                          gradients.features,
                          gradients.inverse_depth,
                          std::as_const(frame.channels).span(),
                          frame.extra_channels(),
                          frame.features,
                          frame.moments.span(),
                          frame.feature_gradients.span()};
  const auto run = [&](auto* kernel) {
    launch(stream, "blend_backward", kernel, dim3(static_cast<std::uint32_t>(frame.tiles())), dim3(kTilePixels),
           TileLists(frame), in);
  };
  if (!extra_gradients) {  // extra channels that no gradient comes from change nothing
    absolute ? run(blend_backward_kernel<true, 0>) : run(blend_backward_kernel<false, 0>);
  } else if (frame.extra_channels() == 1) {
    absolute ? run(blend_backward_kernel<true, 1>) : run(blend_backward_kernel<false, 1>);
  } else {
    absolute ? run(blend_backward_kernel<true, kMaxFeatures + 1>) : run(blend_backward_kernel<false, kMaxFeatures + 1>);
  }
}

}  // namespace splatboost::cuda

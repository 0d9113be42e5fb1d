// SPDX-License-Identifier: Apache-2.0
#include "device/launch.h"
#include "rasterizer/blend_cuda.h"

namespace splatboost::cuda {
namespace {

/// Adds a warp's sums of the first `columns` values to rows[first], rows[first + 1], ...
__device__ inline void add_row(DeviceView<float> rows, std::size_t first, int columns,
                               float (&values)[kMomentColumns]) {
  const float sum = warp_sums(values);
  static_assert(kMomentColumns == 16);
  const int column = static_cast<int>(threadIdx.x % 32) / 2;
  if (threadIdx.x % 2 == 0 && column < columns) atomicAdd(&rows[first + column], sum);
}

struct BlendGradients {
  DeviceView<const float> pixels;  ///< [4 + X, H, W] result of blending
  DeviceView<const float> color, alpha, features, inverse_depth;
  DeviceView<const float> channels;
  int extra;  ///< X
  int features_count;
  DeviceView<float> moments;            ///< [N, kMomentColumns]
  DeviceView<float> feature_gradients;  ///< [N, features]
};

/// Gradients of the images at a pixel.
template <int kMaxExtra>
struct PixelGradients {
  float red, green, blue, alpha;
  float extra[kMaxExtra > 0 ? kMaxExtra : 1];

  /// @param at index of the pixel in a plane
  /// @param counts if false, all gradients are zero
  __device__ PixelGradients(const BlendGradients& in, bool counts, std::size_t plane, std::size_t at) {
    const auto upstream = [&](const DeviceView<const float>& image, int c) {
      return counts && !image.empty() ? image[c * plane + at] : 0.0f;
    };
    red = upstream(in.color, 0);
    green = upstream(in.color, 1);
    blue = upstream(in.color, 2);
    alpha = upstream(in.alpha, 0);
#pragma unroll
    for (int c = 0; c < kMaxExtra; ++c) {
      extra[c] = c >= in.extra           ? 0.0f
                 : c < in.features_count ? upstream(in.features, c)
                                         : upstream(in.inverse_depth, 0);
    }
  }
};

/// Adds one pixel's contribution to a splat's sums, or initialises them with it (kBegins), and advances the pixel past
/// the splat. A pixel that does not blend the splat adds zeros, which is cheaper than a branch.
/// @param rest gradient · (contribution to the image of the splats behind the current one and of the background)
template <bool kAbsolute, bool kBegins, int kMaxExtra>
__device__ inline void add_pixel(const BlendGradients& in, const SplatRecord& splat, const PixelStep& step,
                                 const PixelGradients<kMaxExtra>& g, float& transmittance, float& rest,
                                 float (&moments)[kMomentColumns], float (&features)[kMomentColumns]) {
  const auto add = [](float& sum, float part) { sum = kBegins ? part : sum + part; };
  const float weight = step.blended ? transmittance * step.alpha : 0.0f;
  float along = g.alpha;  // gradient · the splat's own channels; alpha is a channel with value 1
  along = fmaf(g.red, splat.red, along);
  along = fmaf(g.green, splat.green, along);
  along = fmaf(g.blue, splat.blue, along);
  float by_inverse_depth = 0.0f;
#pragma unroll
  for (int c = 0; c < kMaxExtra; ++c) {
    if (c >= in.extra) continue;
    along = fmaf(g.extra[c], in.channels[splat.gaussian * static_cast<std::size_t>(in.extra) + c], along);
    if (c < in.features_count) {
      add(features[c], weight * g.extra[c]);
    } else {
      by_inverse_depth = weight * g.extra[c];
    }
  }
  if (kMaxExtra > 0) add(moments[kMomentInverseDepth], by_inverse_depth);
  const float gain = weight * along;
  rest -= gain;
  // s = α·dL/dα = weight·along − rest·α/(1 − α), and α/(1 − α) = weight/after.
  const float s = step.alpha < kMaxAlpha ? gain - rest * (weight * reciprocal(step.after)) : 0.0f;
  transmittance = step.blended ? step.after : transmittance;
  const float sx = s * step.dx, sy = s * step.dy;
  add(moments[kMomentS], s);
  add(moments[kMomentSX], sx);
  add(moments[kMomentSY], sy);
  add(moments[kMomentSXX], sx * step.dx);
  add(moments[kMomentSXY], sx * step.dy);
  add(moments[kMomentSYY], sy * step.dy);
  add(moments[kMomentRed], weight * g.red);
  add(moments[kMomentGreen], weight * g.green);
  add(moments[kMomentBlue], weight * g.blue);
  if (kAbsolute) {
    const float slope_x = fmaf(2.0f * splat.quadratic_xx, step.dx, splat.quadratic_xy * step.dy);
    const float slope_y = fmaf(2.0f * splat.quadratic_yy, step.dy, splat.quadratic_xy * step.dx);
    add(moments[kMomentAbsX], fabsf(s * slope_x));
    add(moments[kMomentAbsY], fabsf(s * slope_y));
  }
}

/// State of a pixel during the traversal from front to back.
template <int kMaxExtra>
struct PixelAhead {
  PixelGradients<kMaxExtra> g;
  float transmittance = 1.0f;
  float rest;  ///< gradient · (contribution of the splats still to be blended and of the background)

  /// @param covered by at least one splat. Gradients of uncovered pixels are not read: they may be NaN.
  __device__ PixelAhead(const BlendGradients& in, bool covered, std::size_t plane, std::size_t at)
      : g(in, covered, plane, at) {
    const auto blended = [&](int c) { return covered ? in.pixels[c * plane + at] : 0.0f; };
    rest = g.red * blended(0) + g.green * blended(1) + g.blue * blended(2) + g.alpha * blended(3);
#pragma unroll
    for (int c = 0; c < kMaxExtra; ++c) {
      if (c < in.extra) rest = fmaf(g.extra[c], blended(4 + c), rest);
    }
  }
};

/// Front to back with the transmittance recomputed; each warp adds its sums to a splat once.
/// Without extra channels, nvcc's own choice of the number of blocks spills no registers.
/// @tparam kMaxExtra maximum number of extra channels
template <bool kAbsolute, int kMaxExtra>
__global__ void __launch_bounds__(kTileThreads, kMaxExtra == 0 ? 0 : kMinBlocks<kMaxExtra>)
    pixel_backward_kernel(TileLists lists, BlendGradients in) {
  ThreadPixels pixels(lists, blockIdx.x, threadIdx.x);
  const std::size_t plane = static_cast<std::size_t>(lists.width) * lists.height;
  const auto at = [&](int p) { return pixels.at[p].index(lists); };
#pragma unroll
  for (int p = 0; p < kThreadPixels; ++p) pixels.open[p] = pixels.at[p].inside && in.pixels[3 * plane + at(p)] > 0.0f;
  PixelAhead<kMaxExtra> ahead[kThreadPixels] = {{in, pixels.open[0], plane, at(0)}, {in, pixels.open[1], plane, at(1)}};
  visit_splats(lists, blockIdx.x, pixels, [&](const SplatRecord& splat) {
    PixelStep steps[kThreadPixels];
    bool any = false;
#pragma unroll
    for (int p = 0; p < kThreadPixels; ++p) {
      steps[p] = step_pixel(splat, pixels.at[p], ahead[p].transmittance, pixels.open[p]);
      any = any || steps[p].blended;
    }
    if (!__any_sync(kWholeWarp, any)) return;
    float moments[kMomentColumns] = {};
    float features[kMomentColumns] = {};
    add_pixel<kAbsolute, true>(in, splat, steps[0], ahead[0].g, ahead[0].transmittance, ahead[0].rest, moments,
                               features);
    add_pixel<kAbsolute, false>(in, splat, steps[1], ahead[1].g, ahead[1].transmittance, ahead[1].rest, moments,
                                features);
    add_row(in.moments, splat.gaussian * static_cast<std::size_t>(kMomentColumns), kMoments, moments);
    if (kMaxExtra > 0 && in.features_count > 0) {
      add_row(in.feature_gradients, splat.gaussian * static_cast<std::size_t>(in.features_count), in.features_count,
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
  const auto run = [&]<int kMaxExtra>(std::integral_constant<int, kMaxExtra>) {
    const dim3 blocks(static_cast<std::uint32_t>(frame.tiles()));
    const auto kernel = absolute ? pixel_backward_kernel<true, kMaxExtra> : pixel_backward_kernel<false, kMaxExtra>;
    launch(stream, "pixel_backward", kernel, blocks, dim3(kTileThreads), TileLists(frame), in);
  };
  if (!extra_gradients) {  // extra channels without a gradient contribute nothing
    run(std::integral_constant<int, 0>{});
  } else if (frame.extra_channels() == 1) {
    run(std::integral_constant<int, 1>{});
  } else if (frame.extra_channels() <= kPlaneChannels) {
    run(std::integral_constant<int, kPlaneChannels>{});
  } else {
    run(std::integral_constant<int, kMaxFeatures + 1>{});
  }
}

}  // namespace splatboost::cuda

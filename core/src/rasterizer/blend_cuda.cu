// SPDX-License-Identifier: Apache-2.0
#include "device/launch.h"
#include "rasterizer/blend_cuda.h"

namespace splatboost::cuda {
namespace {

struct BlendImages {
  DeviceView<float> pixels;  ///< [4 + X, H, W] the frame's own copy, for the backward pass
  DeviceView<float> color, alpha, features, inverse_depth;
  DeviceView<const float> channels;
  int extra;  ///< X
  int features_count;
  float background[3];
};

/// State of a pixel during blending.
template <int kMaxExtra>
struct Blended {
  float transmittance = 1.0f;
  float red = 0.0f, green = 0.0f, blue = 0.0f;
  float extra[kMaxExtra > 0 ? kMaxExtra : 1] = {};

  __device__ void write(const TileLists& lists, const TilePixel& pixel, const BlendImages& images) const {
    const std::size_t plane = static_cast<std::size_t>(lists.width) * lists.height, at = pixel.index(lists);
    const float color[3] = {fmaf(transmittance, images.background[0], red),
                            fmaf(transmittance, images.background[1], green),
                            fmaf(transmittance, images.background[2], blue)};
    for (int c = 0; c < 3; ++c) {
      if (!images.color.empty()) images.color[c * plane + at] = color[c];
      images.pixels[c * plane + at] = color[c];
    }
    const float alpha = 1.0f - transmittance;
    images.pixels[3 * plane + at] = alpha;
    if (!images.alpha.empty()) images.alpha[at] = alpha;
#pragma unroll
    for (int c = 0; c < kMaxExtra; ++c) {
      if (c >= images.extra) break;
      images.pixels[(4 + c) * plane + at] = extra[c];
      if (c < images.features_count) {
        images.features[c * plane + at] = extra[c];
      } else {
        images.inverse_depth[at] = extra[c];
      }
    }
  }
};

/// @tparam kMaxExtra maximum number of extra channels
template <int kMaxExtra>
__global__ void __launch_bounds__(kTileThreads, kMinBlocks<kMaxExtra>)
    blend_kernel(TileLists lists, BlendImages images) {
  ThreadPixels pixels(lists, blockIdx.x, threadIdx.x);
  Blended<kMaxExtra> blended[kThreadPixels];
  const auto step_behind = [&](const SplatRecord& splat) {
#pragma unroll
    for (int p = 0; p < kThreadPixels; ++p) {
      Blended<kMaxExtra>& of = blended[p];
      const PixelStep step = step_pixel(splat, pixels.at[p], of.transmittance, pixels.open[p]);
      if (!step.blended) continue;
      const float weight = of.transmittance * step.alpha;
      of.transmittance = step.after;
      of.red = fmaf(weight, splat.red, of.red);
      of.green = fmaf(weight, splat.green, of.green);
      of.blue = fmaf(weight, splat.blue, of.blue);
#pragma unroll
      for (int c = 0; c < kMaxExtra; ++c) {
        if (c < images.extra) {
          const float channel = images.channels[splat.gaussian * static_cast<std::size_t>(images.extra) + c];
          of.extra[c] = fmaf(weight, channel, of.extra[c]);
        }
      }
    }
  };
  visit_splats(lists, blockIdx.x, pixels, step_behind);
#pragma unroll
  for (int p = 0; p < kThreadPixels; ++p) {
    if (pixels.at[p].inside) blended[p].write(lists, pixels.at[p], images);
  }
}

}  // namespace

void blend(CudaFrame& frame, const RasterImages& images, CudaStream& stream) {
  const int extra = frame.extra_channels();
  frame.pixels.ensure((4 + static_cast<std::size_t>(extra)) * frame.image_pixels());
  const glm::vec3 background = frame.options.background;
  const BlendImages out{frame.pixels.span(),
                        images.color,
                        images.alpha,
                        images.features,
                        images.inverse_depth,
                        std::as_const(frame.channels).span(),
                        extra,
                        frame.features,
                        {background.x, background.y, background.z}};
  const auto run = [&](auto* kernel) {
    launch(stream, "blend", kernel, dim3(static_cast<std::uint32_t>(frame.tiles())), dim3(kTileThreads),
           TileLists(frame), out);
  };
  if (extra == 0) {
    run(blend_kernel<0>);
  } else if (extra == 1) {
    run(blend_kernel<1>);
  } else if (extra <= kPlaneChannels) {
    run(blend_kernel<kPlaneChannels>);
  } else {
    run(blend_kernel<kMaxFeatures + 1>);
  }
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
#include "blend_cuda.h"
#include "launch.h"

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

/// @tparam kMostExtra room for that many extra channels
template <int kMostExtra>
__global__ void __launch_bounds__(kTilePixels) blend_kernel(TileLists lists, BlendImages images) {
  const TilePixel pixel(lists, blockIdx.x);
  bool open = pixel.inside;
  float transmittance = 1.0f;
  float red = 0.0f, green = 0.0f, blue = 0.0f;
  float extra[kMostExtra > 0 ? kMostExtra : 1] = {};
  visit_splats(lists, blockIdx.x, pixel, open, [&](std::uint32_t gaussian, const SplatRecord& splat) {
    const PixelStep step = step_pixel(splat, pixel, transmittance, open);
    if (!step.blended) return;
    const float weight = transmittance * step.alpha;
    transmittance = step.after;
    red = fmaf(weight, splat.red, red);
    green = fmaf(weight, splat.green, green);
    blue = fmaf(weight, splat.blue, blue);
#pragma unroll
    for (int c = 0; c < kMostExtra; ++c) {
      if (c < images.extra) {
        extra[c] = fmaf(weight, images.channels[gaussian * static_cast<std::size_t>(images.extra) + c], extra[c]);
      }
    }
  });
  if (!pixel.inside) return;

  const std::size_t plane = static_cast<std::size_t>(lists.width) * lists.height, at = pixel.index(lists);
  const float color[3] = {fmaf(transmittance, images.background[0], red),
                          fmaf(transmittance, images.background[1], green),
                          fmaf(transmittance, images.background[2], blue)};
  for (int c = 0; c < 3; ++c) {
    images.color[c * plane + at] = color[c];
    images.pixels[c * plane + at] = color[c];
  }
  const float alpha = 1.0f - transmittance;
  images.pixels[3 * plane + at] = alpha;
  if (!images.alpha.empty()) images.alpha[at] = alpha;
#pragma unroll
  for (int c = 0; c < kMostExtra; ++c) {
    if (c >= images.extra) break;
    images.pixels[(4 + c) * plane + at] = extra[c];
    if (c < images.features_count) {
      images.features[c * plane + at] = extra[c];
    } else {
      images.inverse_depth[at] = extra[c];
    }
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
    launch(stream, "blend", kernel, dim3(static_cast<std::uint32_t>(frame.tiles())), dim3(kTilePixels),
           TileLists(frame), out);
  };
  if (extra == 0) {
    run(blend_kernel<0>);
  } else if (extra == 1) {
    run(blend_kernel<1>);
  } else {
    run(blend_kernel<kMaxFeatures + 1>);
  }
}

}  // namespace splatboost::cuda

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

/// Data that blending keeps for the per-splat backward pass.
struct KeptStates {
  DeviceView<const std::uint32_t> bucket_offsets;
  DeviceView<std::uint32_t> bucket_tiles, pixel_stops, tile_stops;
  DeviceView<float> states;
};

/// State of a pixel during blending.
template <int kMaxExtra>
struct Blended {
  float transmittance = 1.0f;
  float red = 0.0f, green = 0.0f, blue = 0.0f;
  float extra[kMaxExtra > 0 ? kMaxExtra : 1] = {};
  std::uint32_t stop = 0;  ///< one past the last entry of the tile's list that the pixel blended

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
template <int kMaxExtra, bool kKeepsStates>
__global__ void __launch_bounds__(kTileThreads, kMinBlocks<kMaxExtra>)
    blend_kernel(TileLists lists, BlendImages images, KeptStates kept) {
  ThreadPixels pixels(lists, blockIdx.x, threadIdx.x);
  Blended<kMaxExtra> blended[kThreadPixels];
  std::uint32_t first_bucket = 0;
  if (kKeepsStates) {
    first_bucket = kept.bucket_offsets[blockIdx.x];
    const std::uint32_t end = kept.bucket_offsets[blockIdx.x + 1];
    for (std::uint32_t b = first_bucket + threadIdx.x; b < end; b += kTileThreads) kept.bucket_tiles[b] = blockIdx.x;
  }
  const auto keep = [&](std::uint32_t bucket) {
    if (!kKeepsStates) return;
    const std::size_t planes = 4 + static_cast<std::size_t>(images.extra);
#pragma unroll
    for (int p = 0; p < kThreadPixels; ++p) {
      const std::size_t row =
          (first_bucket + bucket) * planes * kTilePixels + TilePixel::number_of(threadIdx.x, static_cast<unsigned>(p));
      kept.states[row] = blended[p].transmittance;
      kept.states[row + kTilePixels] = blended[p].red;
      kept.states[row + 2 * kTilePixels] = blended[p].green;
      kept.states[row + 3 * kTilePixels] = blended[p].blue;
#pragma unroll
      for (int c = 0; c < kMaxExtra; ++c) {
        if (c < images.extra) {
          kept.states[row + (4 + c) * static_cast<std::size_t>(kTilePixels)] = blended[p].extra[c];
        }
      }
    }
  };
  const auto step_behind = [&](std::uint32_t index, const SplatRecord& splat) {
#pragma unroll
    for (int p = 0; p < kThreadPixels; ++p) {
      Blended<kMaxExtra>& of = blended[p];
      const PixelStep step = step_pixel(splat, pixels.at[p], of.transmittance, pixels.open[p]);
      if (!step.blended) continue;
      of.stop = index + 1;
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
  visit_splats(lists, blockIdx.x, pixels, step_behind, keep);
#pragma unroll
  for (int p = 0; p < kThreadPixels; ++p) {
    if (kKeepsStates) {
      const std::size_t row = blockIdx.x * static_cast<std::size_t>(kTilePixels);
      kept.pixel_stops[row + TilePixel::number_of(threadIdx.x, static_cast<unsigned>(p))] = blended[p].stop;
      const std::uint32_t most = warp_max(blended[p].stop);
      if (threadIdx.x % 32 == 0 && most > 0) atomicMax(&kept.tile_stops[blockIdx.x], most);
    }
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
  KeptStates kept;
  if (frame.keeps_states) {
    frame.bucket_states.ensure(frame.bucket_room * (4 + static_cast<std::size_t>(extra)) * kTilePixels);
    frame.bucket_tiles.ensure(frame.bucket_room);
    frame.pixel_stops.ensure(frame.tiles() * kTilePixels);
    frame.tile_stops.ensure(frame.tiles());
    frame.tile_stops.fill_zero();
    kept = {std::as_const(frame.bucket_offsets).span(), frame.bucket_tiles.span(), frame.pixel_stops.span(),
            frame.tile_stops.span(), frame.bucket_states.span()};
  }
  const auto run = [&](auto* kernel) {
    launch(stream, "blend", kernel, dim3(static_cast<std::uint32_t>(frame.tiles())), dim3(kTileThreads),
           TileLists(frame), out, kept);
  };
  const bool keeps = frame.keeps_states;
  if (extra == 0) {
    run(keeps ? blend_kernel<0, true> : blend_kernel<0, false>);
  } else if (extra == 1) {
    run(keeps ? blend_kernel<1, true> : blend_kernel<1, false>);
  } else if (extra <= kPlaneChannels) {
    run(keeps ? blend_kernel<kPlaneChannels, true> : blend_kernel<kPlaneChannels, false>);
  } else {
    run(keeps ? blend_kernel<kMaxFeatures + 1, true> : blend_kernel<kMaxFeatures + 1, false>);
  }
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
/// @file One tile of pixels on a GPU: the walk through its splats and the arithmetic of one splat at one pixel, which
/// blending, its gradient and the count replay must share to the last bit. For .cu files.
///
/// A block is a tile; a warp is 8 × 4 of its pixels. Splats come in batches through shared memory. Before a warp looks
/// at 32 of them, each lane asks of one whether it reaches the warp's pixels at all.
#pragma once

#include <cmath>

#include "cuda_frame.h"
#include "device_view.h"
#include "splatboost/constants.h"

namespace splatboost::cuda {

inline constexpr unsigned kWholeWarp = 0xffffffffu;
/// Splats of a batch: one a thread.
inline constexpr std::uint32_t kBatchSplats = kTilePixels;
inline constexpr int kWarpWidth = 8, kWarpHeight = 4;

/// What all of these kernels read.
struct TileLists {
  DeviceView<const TileEntries> tiles;
  DeviceView<const std::uint32_t> entries;
  DeviceView<const SplatRecord> records;
  std::uint32_t tiles_x;
  std::uint32_t width, height;

  explicit TileLists(const CudaFrame& frame)
      : tiles(frame.tile_entries.span()),
        entries(frame.entries.span()),
        records(frame.records.span()),
        tiles_x(static_cast<std::uint32_t>(frame.tiles_x)),
        width(static_cast<std::uint32_t>(frame.camera.width)),
        height(static_cast<std::uint32_t>(frame.camera.height)) {}
};

/// Where a thread's pixel lies, and its warp's.
struct TilePixel {
  std::uint32_t x, y;
  bool inside;  ///< of the image
  float centre_x, centre_y;
  float warp_x, warp_y;  ///< centre of the warp's first pixel

  /// @param thread of the tile's block
  __device__ TilePixel(const TileLists& lists, std::uint32_t tile, std::uint32_t thread) {
    const std::uint32_t warp = thread / 32, lane = thread % 32;
    const std::uint32_t x0 = tile % lists.tiles_x * kTileSize + warp % 2 * kWarpWidth;
    const std::uint32_t y0 = tile / lists.tiles_x * kTileSize + warp / 2 * kWarpHeight;
    x = x0 + lane % kWarpWidth;
    y = y0 + lane / kWarpWidth;
    inside = x < lists.width && y < lists.height;
    centre_x = static_cast<float>(x) + 0.5f;
    centre_y = static_cast<float>(y) + 0.5f;
    warp_x = static_cast<float>(x0) + 0.5f;
    warp_y = static_cast<float>(y0) + 0.5f;
  }
  /// In a plane of the image.
  __device__ std::size_t index(const TileLists& lists) const { return static_cast<std::size_t>(y) * lists.width + x; }
};

/// log2 α at an offset from the mean. Every operation is spelled out: what the compiler contracts must not differ from
/// kernel to kernel.
__device__ inline float exponent_at(const SplatRecord& splat, float dx, float dy) {
  const float constant = fmaf(dx * dx, splat.quadratic_xx, splat.log2_opacity);
  return fmaf(dy, fmaf(dy, splat.quadratic_yy, dx * splat.quadratic_xy), constant);
}

/// Whether a splat may reach α = 1/255 at a pixel of the warp. The greatest exponent over a rectangle that does not
/// hold the mean is on an edge that faces it.
__device__ inline bool may_reach(const SplatRecord& splat, const TilePixel& pixel) {
  constexpr float kSlack = 0.02f;  // more than rounding; the exact test is per pixel
  const float left = pixel.warp_x - splat.mean_x, right = left + (kWarpWidth - 1);
  const float top = pixel.warp_y - splat.mean_y, bottom = top + (kWarpHeight - 1);
  const float edge_x = fminf(fmaxf(0.0f, left), right), edge_y = fminf(fmaxf(0.0f, top), bottom);
  // Along the edge of x (y): where the slope across it is zero.
  const float at_y = fminf(fmaxf(-0.5f * splat.quadratic_xy * edge_x / splat.quadratic_yy, top), bottom);
  const float at_x = fminf(fmaxf(-0.5f * splat.quadratic_xy * edge_y / splat.quadratic_xx, left), right);
  const float greatest = fmaxf(exponent_at(splat, edge_x, at_y), exponent_at(splat, at_x, edge_y));
  return greatest >= kMinLog2Alpha - kSlack;
}

/// What one splat does to one pixel.
struct PixelStep {
  float dx, dy;
  float alpha;
  float after;  ///< transmittance behind it
  bool blended;
};

/// Takes a pixel behind a splat, but for its transmittance. A pixel that the splat would saturate is closed before it.
__device__ inline PixelStep step_pixel(const SplatRecord& splat, const TilePixel& pixel, float transmittance,
                                       bool& open) {
  PixelStep step;
  step.dx = pixel.centre_x - splat.mean_x;
  step.dy = pixel.centre_y - splat.mean_y;
  const float exponent = exponent_at(splat, step.dx, step.dy);
  step.blended = open && exponent >= kMinLog2Alpha;
  step.alpha = fminf(exp2f(exponent), kMaxAlpha);
  step.after = fmaf(-transmittance, step.alpha, transmittance);
  if (step.blended && step.after < kMinTransmittance) open = step.blended = false;
  return step;
}

/// Walks through a tile's splats, near to far, until all its pixels are closed. All threads of the block call it.
/// @param open whether the thread's pixel takes part
/// @param visit (index in the tile's list, gaussian, splat): called by whole warps, for splats that may reach one of
///     their pixels; closes `open`
/// @param begin_bucket (number): called by whole warps before each kBucketSplats of the list
template <class Visit, class BeginBucket>
__device__ void visit_splats(const TileLists& lists, std::uint32_t tile, const TilePixel& pixel, bool& open,
                             Visit&& visit, BeginBucket&& begin_bucket) {
  __shared__ SharedArray<SplatRecord, kBatchSplats> batch;
  __shared__ SharedArray<std::uint32_t, kBatchSplats> gaussians;
  const TileEntries range = lists.tiles[tile];
  const int lane = static_cast<int>(threadIdx.x % 32);
  for (std::uint32_t base = range.begin; base < range.end; base += kBatchSplats) {
    if (!__syncthreads_or(open)) break;  // and nobody reads the last batch any more
    if (base + threadIdx.x < range.end) {
      const std::uint32_t gaussian = lists.entries[base + threadIdx.x];
      gaussians.set(static_cast<int>(threadIdx.x), gaussian);
      batch.set(static_cast<int>(threadIdx.x), lists.records[gaussian]);
    }
    __syncthreads();
    const int count = static_cast<int>(min(kBatchSplats, range.end - base));
    for (int group = 0; group < count; group += 32) {
      if (!__any_sync(kWholeWarp, open)) break;
      const std::uint32_t index = base - range.begin + static_cast<std::uint32_t>(group);
      begin_bucket(index / kBucketSplats);
      const int own = group + lane;
      unsigned reaching = __ballot_sync(kWholeWarp, own < count && may_reach(batch.get(min(own, count - 1)), pixel));
      for (; reaching != 0; reaching &= reaching - 1) {
        const int next = __ffs(static_cast<int>(reaching)) - 1;
        visit(index + static_cast<std::uint32_t>(next), gaussians.get(group + next), batch.get(group + next));
      }
    }
  }
}
template <class Visit>
__device__ void visit_splats(const TileLists& lists, std::uint32_t tile, const TilePixel& pixel, bool& open,
                             Visit&& visit) {
  visit_splats(lists, tile, pixel, open, visit, [](std::uint32_t) {});
}

}  // namespace splatboost::cuda

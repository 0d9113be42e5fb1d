// SPDX-License-Identifier: Apache-2.0
/// @file One tile of pixels on a GPU: the traversal of its splats and the arithmetic of one splat at one pixel, which
/// blending, its gradient and the count replay must share to the last bit. For .cu files.
///
/// One block per tile, one warp per 8 × 8 pixels, one thread per two of these, in the same column, which share the cost
/// of the traversal and of the warp's sums per splat. Splats are loaded into shared memory in batches. Before a warp
/// processes 32 of them, each lane tests for one splat whether it can reach the warp's pixels at all.
#pragma once

#include <cmath>

#include "device/device_view.h"
#include "device/launch.h"
#include "projection/cuda_frame.h"
#include "splatboost/constants.h"
#include "splatboost/gaussian_planes.h"

namespace splatboost::cuda {

inline constexpr int kThreadPixels = 2;
inline constexpr std::uint32_t kTileThreads = kTilePixels / kThreadPixels;
/// Minimum number of blocks per multiprocessor, for __launch_bounds__. Without it, nvcc spills registers to fit more.
/// @tparam kMaxExtra maximum number of extra channels
template <int kMaxExtra>
inline constexpr unsigned kMinBlocks = kMaxExtra > 1 ? 5 : 8;
/// Splats of a batch: one per thread.
inline constexpr std::uint32_t kBatchSplats = kTileThreads;
/// Pixels of a warp: 32 in rows of 8, then the next 32 below.
inline constexpr int kWarpWidth = 8, kWarpHeight = 32 / kWarpWidth * kThreadPixels;
inline constexpr std::uint32_t kWarpsAcross = kTileSize / kWarpWidth;

/// Inputs of all of these kernels.
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

/// Centre of a warp's first pixel.
struct WarpCorner {
  float x, y;

  __device__ WarpCorner(const TileLists& lists, std::uint32_t tile, std::uint32_t warp) {
    const std::uint32_t column = tile % lists.tiles_x * kTileSize + warp % kWarpsAcross * kWarpWidth;
    const std::uint32_t row = tile / lists.tiles_x * kTileSize + warp / kWarpsAcross * kWarpHeight;
    x = static_cast<float>(column) + 0.5f;
    y = static_cast<float>(row) + 0.5f;
  }
};

/// Position of a pixel of a tile.
struct TilePixel {
  std::uint32_t x, y;
  bool inside;  ///< of the image
  float centre_x, centre_y;

  /// @param which of the lane's pixels, below kThreadPixels
  __device__ TilePixel(const TileLists& lists, std::uint32_t tile, std::uint32_t warp, std::uint32_t lane,
                       std::uint32_t which) {
    x = tile % lists.tiles_x * kTileSize + warp % kWarpsAcross * kWarpWidth + lane % kWarpWidth;
    y = tile / lists.tiles_x * kTileSize + warp / kWarpsAcross * kWarpHeight + lane / kWarpWidth +
        which * (32 / kWarpWidth);
    inside = x < lists.width && y < lists.height;
    centre_x = static_cast<float>(x) + 0.5f;
    centre_y = static_cast<float>(y) + 0.5f;
  }
  /// @param number of the pixel in its tile, as returned by number_of()
  __device__ TilePixel(const TileLists& lists, std::uint32_t tile, std::uint32_t number)
      : TilePixel(lists, tile, number / (32 * kThreadPixels), number % 32, number / 32 % kThreadPixels) {}

  /// Number of a thread's pixel in its tile. Neighbouring lanes have neighbouring numbers.
  __device__ static std::uint32_t number_of(std::uint32_t thread, std::uint32_t which) {
    return (thread / 32 * kThreadPixels + which) * 32 + thread % 32;
  }
  /// Index of the pixel in a plane of the image.
  __device__ std::size_t index(const TileLists& lists) const { return static_cast<std::size_t>(y) * lists.width + x; }
};

/// The pixels of a thread, and which of them are still open.
struct ThreadPixels {
  TilePixel at[kThreadPixels];
  bool open[kThreadPixels];

  /// @param thread index in the tile's block
  __device__ ThreadPixels(const TileLists& lists, std::uint32_t tile, std::uint32_t thread)
      : at{{lists, tile, thread / 32, thread % 32, 0}, {lists, tile, thread / 32, thread % 32, 1}},
        open{at[0].inside, at[1].inside} {}
  __device__ bool any_open() const { return open[0] || open[1]; }
};
static_assert(kThreadPixels == 2, "ThreadPixels and PixelAhead name both");

/// log2 α at an offset from the mean. The fused operations are explicit, so that the compiler does not contract them
/// differently in different kernels.
__device__ inline float exponent_at(const SplatRecord& splat, float dx, float dy) {
  const float constant = fmaf(dx * dx, splat.quadratic_xx, splat.log2_opacity);
  return fmaf(dy, fmaf(dy, splat.quadratic_yy, dx * splat.quadratic_xy), constant);
}

// One instruction each. Numbers below 2^-126 are flushed to 0, which happens only where a splat is not blended; exp2f()
// and a division need several more instructions to handle such numbers.
__device__ inline float power_of_two(float exponent) {
#ifdef SPLATBOOST_CUDA_ON_CPU
  return cuda_on_cpu::approximate(exp2f(exponent));
#else
  float power;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(power) : "f"(exponent));
  return power;
#endif
}
__device__ inline float reciprocal(float x) {
#ifdef SPLATBOOST_CUDA_ON_CPU
  return cuda_on_cpu::approximate(1.0f / x);
#else
  float inverse;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(x));
  return inverse;
#endif
}

/// Whether a splat may reach α = 1/255 at a pixel of the warp. The greatest exponent over a rectangle that does not
/// contain the mean lies on an edge that faces the mean.
__device__ inline bool may_reach(const SplatRecord& splat, const WarpCorner& corner) {
  constexpr float kSlack = 0.02f;  // larger than rounding errors; the exact test is per pixel
  const float left = corner.x - splat.mean_x, right = left + (kWarpWidth - 1);
  const float top = corner.y - splat.mean_y, bottom = top + (kWarpHeight - 1);
  const float edge_x = fminf(fmaxf(0.0f, left), right), edge_y = fminf(fmaxf(0.0f, top), bottom);
  // Maximum on the edge at edge_x (edge_y): where the derivative along the edge is zero.
  const float slope = -0.5f * splat.quadratic_xy;
  const float at_y = fminf(fmaxf(slope * edge_x * reciprocal(splat.quadratic_yy), top), bottom);
  const float at_x = fminf(fmaxf(slope * edge_y * reciprocal(splat.quadratic_xx), left), right);
  const float greatest = fmaxf(exponent_at(splat, edge_x, at_y), exponent_at(splat, at_x, edge_y));
  return greatest >= kMinLog2Alpha - kSlack;
}

/// Effect of one splat on one pixel.
struct PixelStep {
  float dx, dy;
  float alpha;
  float after;  ///< transmittance behind the splat
  bool blended;
};

/// Applies a splat to a pixel; the caller updates the transmittance. A pixel that the splat would saturate is closed
/// without blending it.
__device__ inline PixelStep step_pixel(const SplatRecord& splat, const TilePixel& pixel, float transmittance,
                                       bool& open) {
  PixelStep step;
  step.dx = pixel.centre_x - splat.mean_x;
  step.dy = pixel.centre_y - splat.mean_y;
  const float exponent = exponent_at(splat, step.dx, step.dy);
  step.blended = open && exponent >= kMinLog2Alpha;
  step.alpha = fminf(power_of_two(exponent), kMaxAlpha);
  step.after = fmaf(-transmittance, step.alpha, transmittance);
  if (step.blended && step.after < kMinTransmittance) open = step.blended = false;
  return step;
}

/// Visits a tile's splats, near to far, until all its pixels are closed. All threads of the block must call it.
/// @param visit (splat): called by whole warps, for splats that may reach one of their pixels; may close pixels
template <class Visit>
__device__ void visit_splats(const TileLists& lists, std::uint32_t tile, const ThreadPixels& pixels, Visit&& visit) {
  __shared__ SharedArray<SplatRecord, kBatchSplats> batch;
  const TileEntries range = lists.tiles[tile];
  const WarpCorner corner(lists, tile, threadIdx.x / 32);
  const int lane = static_cast<int>(threadIdx.x % 32);
  for (std::uint32_t base = range.begin; base < range.end; base += kBatchSplats) {
    if (!__syncthreads_or(pixels.any_open())) break;  // also a barrier: the previous batch is no longer read
    if (base + threadIdx.x < range.end) {
      batch.set(static_cast<int>(threadIdx.x), lists.records[lists.entries[base + threadIdx.x]]);
    }
    __syncthreads();
    const int count = static_cast<int>(min(kBatchSplats, range.end - base));
    for (int group = 0; group < count; group += 32) {
      if (!__any_sync(kWholeWarp, pixels.any_open())) break;
      const int own = group + lane;
      unsigned reaching = __ballot_sync(kWholeWarp, own < count && may_reach(batch.get(min(own, count - 1)), corner));
      for (; reaching != 0; reaching &= reaching - 1) {
        visit(batch.get(group + __ffs(static_cast<int>(reaching)) - 1));
      }
    }
  }
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
/// @file The amount of work to blend a scene, counted rather than timed.
#pragma once

#include <cstdint>

#include "splatboost/threads.h"
#include "trainer/synth/bench_scene.h"

namespace splatboost::program {

/// A block of pixels that a device processes together for a splat; each side is a power of two, at most that of a tile.
struct PixelCell {
  std::size_t width, height;
  std::size_t pixels() const { return width * height; }
};
inline constexpr PixelCell kTileRow{16, 1};           ///< on a CPU
inline constexpr PixelCell kInstructionPixels{8, 4};  ///< on a GPU: pixels of one instruction of a warp ...
inline constexpr PixelCell kWarpPixels{8, 8};         ///< ... and of a whole warp, which adds its sums to a splat once

/// Counts of one view, drawn with the exact compact box (β = 1).
struct BlendWork {
  std::uint64_t pixels = 0;
  std::uint64_t visible = 0;  ///< splats in at least one tile
  std::uint64_t entries = 0;  ///< (tile, splat) pairs of the tile lists
  std::uint64_t cells = 0;    ///< (cell, splat) pairs with at least one blended pixel
  std::uint64_t pairs = 0;    ///< (pixel, splat) pairs that are blended
};

BlendWork count_blend_work(const BenchScene& bench, const PixelCell& cell, const Threads& threads);

/// Floating-point operations and bytes that a kernel needs at least.
///
/// Operations: those of all pixels of each cell, as in SIMD. A multiply-add counts as two; add, multiply, minimum,
/// rounding and reciprocal estimate as one; compares, masks, integer operations and cells that the splat misses as
/// none.
/// Bytes: what the kernel reads and writes of the lists, the splats' records, entry gradients and images, each once per
/// entry or pixel; caches save part of this.
struct Effort {
  double operations = 0;
  double bytes = 0;
};
/// On the CPU. @param work counted by kTileRow
Effort blend_effort(const BlendWork& work);
Effort blend_backward_effort(const BlendWork& work);

}  // namespace splatboost::program

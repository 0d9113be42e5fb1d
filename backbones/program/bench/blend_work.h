// SPDX-License-Identifier: Apache-2.0
/// @file How much work blending a scene is, counted rather than timed.
#pragma once

#include <cstdint>

#include "splatboost/threads.h"
#include "trainer/synth/bench_scene.h"

namespace splatboost::program {

/// Pixels that a device takes through a splat together; a power of two each way, of at most a tile.
struct PixelCell {
  std::size_t width, height;
  std::size_t pixels() const { return width * height; }
};
inline constexpr PixelCell kTileRow{16, 1};           ///< of a CPU
inline constexpr PixelCell kInstructionPixels{8, 4};  ///< of a GPU: of one instruction of a warp ...
inline constexpr PixelCell kWarpPixels{8, 8};         ///< ... and of a warp, which adds to a splat once

/// Counts of one view, drawn with the exact compact box (β = 1).
struct BlendWork {
  std::uint64_t pixels = 0;
  std::uint64_t visible = 0;  ///< splats that are listed in a tile
  std::uint64_t entries = 0;  ///< (tile, splat) pairs of the tile lists
  std::uint64_t cells = 0;    ///< (cell, splat) pairs with at least one blended pixel
  std::uint64_t pairs = 0;    ///< (pixel, splat) pairs that are blended
};

BlendWork count_blend_work(const BenchScene& bench, const PixelCell& cell, Threads& threads);

/// Floating-point operations and bytes that a kernel cannot do without.
///
/// Operations: of each cell all pixels, as SIMD does them. A multiply-add is two; add, multiply, minimum, rounding and
/// reciprocal estimate are one; compares, masks and integers are none; nor are cells that the splat misses.
/// Bytes: what the kernel reads and writes of the lists, the splats' records, entry gradients and images, each once an
/// entry or a pixel; caches spare a part of them.
struct Effort {
  double operations = 0;
  double bytes = 0;
};
/// On the CPU, of work counted by kTileRow.
Effort blend_effort(const BlendWork& work);
Effort blend_backward_effort(const BlendWork& work);

}  // namespace splatboost::program

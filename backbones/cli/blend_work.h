// SPDX-License-Identifier: Apache-2.0
/// @file How much work blending a scene is, counted rather than timed.
#pragma once

#include <cstdint>

#include "common/bench_scene.h"
#include "splatboost/threads.h"

namespace splatboost::cli {

/// Counts of one view, drawn with the exact compact box (β = 1).
struct BlendWork {
  std::uint64_t pixels = 0;
  std::uint64_t entries = 0;  ///< (tile, splat) pairs of the tile lists
  std::uint64_t rows = 0;     ///< (tile row of 16 pixels, splat) pairs with at least one blended pixel
  std::uint64_t pairs = 0;    ///< (pixel, splat) pairs that are blended
};

BlendWork count_blend_work(const BenchScene& bench, Threads& threads);

/// Floating-point operations and bytes that a kernel cannot do without.
///
/// Operations: of each row all 16 pixels, as SIMD does them. A multiply-add is two; add, multiply, minimum, rounding
/// and reciprocal estimate are one; compares, masks and integers are none; nor are rows that the splat misses.
/// Bytes: what the kernel reads and writes of the lists, the splats' records, entry gradients and images, each once an
/// entry or a pixel; caches spare a part of them.
struct Effort {
  double operations = 0;
  double bytes = 0;
};
Effort blend_effort(const BlendWork& work);
Effort blend_backward_effort(const BlendWork& work);

}  // namespace splatboost::cli

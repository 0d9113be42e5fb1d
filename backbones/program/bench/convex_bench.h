// SPDX-License-Identifier: Apache-2.0
/// @file The fixed scene of convexes that `splatboost bench` measures, and how much work blending it is.
#pragma once

#include <memory>
#include <vector>

#include "program/bench/blend_work.h"
#include "splatboost/convex_rasterizer.h"
#include "trainer/backbone_api/backbone.h"
#include "trainer/synth/bench_scene.h"

namespace splatboost::program {

/// A convex for each splat of a BenchScene: six points about the splat's mean, which reach 2.4 of its deviations, with
/// edges about two pixels soft. Same size, same bytes.
struct ConvexBench {
  BenchScene splats;
  std::vector<float> points, log_smoothness, log_sharpness;  ///< [N,6,3], [N], [N]; the rest is the splats'
  std::vector<float> smoothness, sharpness;                  ///< [N], activated
  /// Views of this scene.
  Convexes convexes() const;
};

/// 20k convexes at 400×300.
const BenchSize& convex_bench_size();
ConvexBench make_convex_bench(const BenchSize& size);

/// The published backbone with these convexes and rates of nearly zero: every repeat then sees the same scene.
std::unique_ptr<Backbone> make_still_convexes(const ConvexBench& bench, Threads& threads);

/// Counts of one view, drawn with the exact compact box (β = 1).
BlendWork count_blend_work(const ConvexBench& bench, const PixelCell& cell, Threads& threads);

/// On the CPU, of work counted by kTileRow, as blend_effort(). Operations are those of hulls of six edges where one
/// edge decides: pixels that need the sum over edges are not counted, and take more than twice as many.
Effort blend_convexes_effort(const BlendWork& work);
Effort blend_convexes_backward_effort(const BlendWork& work);

}  // namespace splatboost::program

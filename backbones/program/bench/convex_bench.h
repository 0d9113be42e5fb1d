// SPDX-License-Identifier: Apache-2.0
/// @file The fixed scene of convexes that `splatboost bench` measures, and the amount of work to blend it.
#pragma once

#include <memory>
#include <vector>

#include "program/bench/blend_work.h"
#include "splatboost/convex_rasterizer.h"
#include "trainer/backbone_api/backbone.h"
#include "trainer/synth/bench_scene.h"

namespace splatboost::program {

/// One convex per splat of a BenchScene: six points around the splat's mean at 2.4 of its standard deviations (their
/// geometric mean), with edges about two pixels soft. The same size gives the same bytes.
struct ConvexBench {
  BenchScene splats;
  std::vector<float> points, log_smoothness, log_sharpness;  ///< [N,6,3], [N], [N]; the rest is in `splats`
  std::vector<float> smoothness, sharpness;                  ///< [N], activated
  /// Non-owning: its spans refer to this object.
  Convexes convexes() const;
};

/// 20k convexes at 400×300.
const BenchSize& convex_bench_size();
ConvexBench make_convex_bench(const BenchSize& size);

/// The published backbone with these convexes and learning rates of nearly zero, so that every repeat sees the same
/// scene.
std::unique_ptr<Backbone> make_still_convexes(const ConvexBench& bench, const Threads& threads);

/// Counts of one view, drawn with the exact compact box (β = 1).
BlendWork count_blend_work(const ConvexBench& bench, const PixelCell& cell, const Threads& threads);

/// On the CPU, as blend_effort(). Operations assume hulls of six edges of which one determines the value: pixels that
/// need the sum over edges take more than twice as many, which is not counted.
/// @param work counted by kTileRow
Effort blend_convexes_effort(const BlendWork& work);
Effort blend_convexes_backward_effort(const BlendWork& work);

}  // namespace splatboost::program

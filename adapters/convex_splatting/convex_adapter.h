// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for 3D Convex Splatting, whose primitives are convexes: VCD gates the convexes that would split, VCP
/// thins the removal that belongs to growth and removes late, CB draws less.
#pragma once

#include <concepts>
#include <cstdint>
#include <optional>
#include <string_view>
#include <type_traits>
#include <vector>

#include "registry/adapter.h"
#include "splatboost/blending_weights.h"
#include "splatboost/device.h"
#include "splatboost/hooks.h"
#include "splatboost/multi_view_scores.h"

namespace splatboost {

/// The parts and constants of the method. Iteration numbers are of the published run (30 000) and scale with length.
struct ConvexBoost {
  /// The paper's rules alone: importance counts whole pixels, late pruning begins at half of the run, and what is faint
  /// is so at 0.1.
  bool literal = false;
  bool vcd = true;       ///< multi-view consistent densification
  bool vcp = true;       ///< multi-view consistent pruning
  bool cb = true;        ///< compact box
  bool schedule = true;  ///< optimizer schedule of all seven groups
  float beta = 0.5f;
  double tau_d = 5;  ///< importance that a split must exceed by a pixel for each convex it adds; less in small images
  int views = 10;    ///< K
  float tau = 0.1f;  ///< error threshold
  float lambda_dssim = 0.2f;
  int late_prune_from = 10000;  ///< when growth has ended; the paper's is 15 000
  int late_prune_interval = 3000;
  /// The release's own bound. Its convexes begin at an opacity of 0.1 and halve it with every split: the paper's 0.1
  /// would take what is drawn.
  double late_min_opacity = 0.03;
  double late_max_score = 0.9;
  /// Where late pruning begins, once: the convexes of the smallest blending weights go, as many as have this share of
  /// the sum of all together. Not the paper's.
  double late_share = 0.02;
  /// An in-tree trainer begins with views of half the size. Not the paper's.
  bool coarse = false;
  double coarse_until = 0.3;  ///< share of the run

  std::uint64_t seed = 0;  ///< the run's
};

/// Calls visit(name, field) for every setting.
template <class Boost, class Visitor>
requires std::same_as<std::remove_const_t<Boost>, ConvexBoost>
void for_each_field(Boost& boost, Visitor&& visit) {
  visit("literal", boost.literal);
  visit("vcd", boost.vcd);
  visit("vcp", boost.vcp);
  visit("cb", boost.cb);
  visit("schedule", boost.schedule);
  visit("beta", boost.beta);
  visit("tau_d", boost.tau_d);
  visit("views", boost.views);
  visit("tau", boost.tau);
  visit("lambda_dssim", boost.lambda_dssim);
  visit("late_prune_from", boost.late_prune_from);
  visit("late_prune_interval", boost.late_prune_interval);
  visit("late_min_opacity", boost.late_min_opacity);
  visit("late_max_score", boost.late_max_score);
  visit("late_share", boost.late_share);
  visit("coarse", boost.coarse);
  visit("coarse_until", boost.coarse_until);
}

/// Throws ArgumentError that names the setting unless all values are possible.
void check(const ConvexBoost& boost);

/// The paper's text and numbers (supplement, Secs. 9.1 and 9.3).
ConvexBoost literal_convex_boost();

/// What an accepted split adds: six children for their parent, where a Gaussian's adds one. Ours, not the paper's.
inline constexpr double kAddedByASplit = 5;

class ConvexAdapter final : public Adapter {
 public:
  /// @param device the backbone's: where views are scored
  ConvexAdapter(const ConvexBoost& boost, Device device);

  std::optional<float> beta() const override;

  /// A split that the backbone wants stays where the flagged pixels a view are at least (τ_d + 1) · kAddedByASplit.
  void grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) override;
  bool prunes_at(Moment moment, bool backbone_would) const override;
  /// Within growth half of the backbone's candidates go, drawn by the scores of what they were made from. Its trims
  /// after growth are its own.
  void prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) override;
  bool steps_at(std::string_view group, Moment moment) const override;

 private:
  /// Whether growth has just ended and late pruning begins. Never literally.
  bool growth_ended_at(Moment moment) const;
  bool prunes_late_at(Moment moment) const;
  const ScoreSums& score(Moment moment, RasterizerHook& rasterizer);

  ConvexBoost boost_;
  MultiViewScorer scorer_;
  BlendingWeights weights_;
  std::vector<std::int64_t> importance_;
  std::vector<float> pruning_;  ///< of the primitives at scored_at_
  int scored_at_ = 0;           ///< iteration of the last growth
};

}  // namespace splatboost

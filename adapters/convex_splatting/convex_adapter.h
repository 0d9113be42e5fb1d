// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for 3D Convex Splatting, whose primitives are convexes: VCD gates the splits, VCP thins
/// the pruning within growth and adds late pruning, CB is the compact box.
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

/// The parts and constants of the method. Iteration numbers refer to the published run (30 000) and scale with length.
struct ConvexBoost {
  /// Only the paper's rules: importance counts whole pixels, the compact box is cut (β = 0.5), late pruning begins
  /// at half of the run and removes convexes of an opacity below 0.1.
  bool literal = false;
  bool vcd = true;       ///< multi-view consistent densification
  bool vcp = true;       ///< multi-view consistent pruning
  bool cb = true;        ///< compact box
  bool schedule = true;  ///< optimizer schedule of all seven groups
  /// Factors on the learning rate of higher SH bands, as in VanillaBoost. Not in the paper.
  double rest_rate = 2;
  double rest_rate_few = 4;
  /// 1 is the exact box. The paper's 0.5 cuts the faint rims of convexes, which cost 0.8 dB on one scene of four.
  float beta = 1.0f;
  /// A split needs τ_d + 1 flagged pixels per view for each convex it adds; in small images fewer, but at least 1.
  double tau_d = 5;
  int views = 10;    ///< K
  float tau = 0.1f;  ///< error threshold
  float lambda_dssim = 0.2f;
  int late_prune_from = 10000;  ///< when growth has ended; paper: 15 000
  int late_prune_interval = 3000;
  /// The threshold of the published code, whose convexes start at an opacity of 0.1, halved at every split: the paper's
  /// 0.1 would remove visible convexes.
  double late_min_opacity = 0.03;
  double late_max_score = 0.9;
  /// Once, when late pruning begins: removes the convexes with the smallest blending weights whose weights together are
  /// at most this share of the total. Not in the paper.
  double late_share = 0.02;
  /// The parameters of the last share of the run are averaged, where the backbone does that. 0: not. Not in the paper.
  double average_share = 0.05;
  /// An in-tree trainer starts with half-size views. Not in the paper.
  bool coarse = false;
  double coarse_until = 0.3;  ///< until this share of the run
  /// An in-tree trainer adds points of features that several photos share. Not in the paper. Points in gaps, as in
  /// VanillaBoost, are less exact, and convexes there cover new views.
  bool track_points = true;
  /// An in-tree trainer scales the lengths of the backbone's settings to the scene. Not in the paper.
  bool scale_lengths = true;
  /// Number of training views, given by the run; 0: not known, and rest_rate applies.
  int training_views = 0;

  std::uint64_t seed = 0;  ///< of the run; not a user setting
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
  visit("rest_rate", boost.rest_rate);
  visit("rest_rate_few", boost.rest_rate_few);
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
  visit("average_share", boost.average_share);
  visit("coarse", boost.coarse);
  visit("coarse_until", boost.coarse_until);
  visit("track_points", boost.track_points);
  visit("scale_lengths", boost.scale_lengths);
  visit("training_views", boost.training_views);
}

/// Throws ArgumentError, naming the setting, if a value is out of range.
void check(const ConvexBoost& boost);

/// The paper's rules and numbers (supplement, Secs. 9.1 and 9.3).
ConvexBoost literal_convex_boost();

/// Convexes that a split adds: six children replace the parent. (A Gaussian's split adds one.) Ours, not the paper's.
inline constexpr int kAddedByASplit = 5;

class ConvexAdapter final : public Adapter {
 public:
  /// @param device the backbone's device, on which views are scored
  ConvexAdapter(const ConvexBoost& boost, Device device);

  std::optional<float> beta() const override;

  /// Keeps the backbone's splits of convexes with at least τ_d + 1 flagged pixels per view for each added convex, fewer
  /// in images below a megapixel, but at least one.
  void grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) override;
  bool needs_weights() const override { return boost_.vcp && boost_.late_share > 0; }
  bool prunes_at(Moment moment, bool backbone_would) const override;
  /// Within growth, removes half of the backbone's candidates, drawn by the pruning scores of the convexes they were
  /// made from. The backbone's trims after growth are left unchanged.
  void prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) override;
  bool steps_at(std::string_view group, Moment moment) const override;
  bool averages_at(Moment moment) const override;
  float rate_factor(std::string_view group, Moment moment) const override;

 private:
  /// Whether growth has just ended and late pruning begins. Always false with the literal rules.
  bool growth_ended_at(Moment moment) const;
  bool prunes_late_at(Moment moment) const;
  const ScoreSums& score(Moment moment, RasterizerHook& rasterizer);

  ConvexBoost boost_;
  MultiViewScorer scorer_;
  BlendingWeights weights_;
  std::vector<std::int64_t> importance_;
  std::vector<float> pruning_;  ///< [N] pruning scores of the primitives at the last scoring
  int scored_at_ = -1;          ///< iteration of the last growth
};

}  // namespace splatboost

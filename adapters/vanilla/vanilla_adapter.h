// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for vanilla 3DGS: VCD, VCP, the compact box, absolute gradients and the optimizer schedule.
#pragma once

#include <concepts>
#include <cstdint>
#include <type_traits>

#include "registry/adapter.h"
#include "splatboost/blending_weights.h"
#include "splatboost/device.h"
#include "splatboost/hooks.h"
#include "splatboost/multi_view_scores.h"
#include "vanilla/scaled_rules.h"

namespace splatboost {

/// The parts and constants of the method. Iteration numbers are of the published run (30 000) and scale with length.
struct VanillaBoost {
  /// The paper's rules alone: τ_d counts whole pixels of images of any size, growth and optimizer steps come at the
  /// paper's intervals in a run of any length, thresholds of gradients and resets of opacities are the backbone's.
  bool literal = false;
  bool vcd = true;       ///< multi-view consistent densification
  bool vcp = true;       ///< multi-view consistent pruning
  bool cb = true;        ///< compact box
  bool absgrad = true;   ///< split on absolute gradients
  bool schedule = true;  ///< optimizer schedule
  float beta = 0.5f;
  double tau_d = 5;  ///< importance that growth must exceed by a pixel; less where images are below kTauDPixels
  int views = 10;    ///< K
  float tau = 0.1f;  ///< error threshold
  float lambda_dssim = 0.2f;
  double gradient_threshold = 2e-4;      ///< clone
  double gradient_abs_threshold = 6e-4;  ///< split; the paper's is 1.2e-3
  double percent_dense = 0.001;          ///< × extent, where clone ends and split begins
  int densify_from = 500;
  /// Growth ends here, but in a short run not before it has grown kMinGrowths times; the paper's is 15 000.
  int densify_until = 10000;
  /// VCD grows every so many iterations, as often as 3DGS; the paper's is 500. Not scaled, because statistics need that
  /// many views, but a longer one shrinks to kMinGrowthInterval where a run would not grow kMinGrowths times.
  int densify_interval = 100;
  /// Opacities are reset only where at least so many iterations of growth follow, as in the published run. Not scaled,
  /// because opacities recover at a rate that does not depend on a run's length.
  int growth_after_reset = 3000;
  int late_prune_from = 10000;  ///< and not before growth has ended; the paper's is 15 000
  int late_prune_interval = 3000;
  double late_min_opacity = 0.1;
  double late_max_score = 0.9;
  /// When growth has ended, once: the Gaussians of the smallest blending weights go, as many as have this share of the
  /// sum of all together. Not the paper's.
  double late_share = 0.05;
  /// An in-tree trainer begins with views of half the size. Not the paper's.
  bool coarse = false;        ///< growth from the first iterations on needs their full size
  double coarse_until = 0.3;  ///< share of the run

  // No settings of the user's: the run's, and the backbone's.
  std::uint64_t seed = 0;
  int published_iterations = kPublishedIterations;  ///< length of the run that iteration numbers are of
};

/// Calls visit(name, field) for every setting.
template <class Boost, class Visitor>
requires std::same_as<std::remove_const_t<Boost>, VanillaBoost>
void for_each_field(Boost& boost, Visitor&& visit) {
  visit("literal", boost.literal);
  visit("vcd", boost.vcd);
  visit("vcp", boost.vcp);
  visit("cb", boost.cb);
  visit("absgrad", boost.absgrad);
  visit("schedule", boost.schedule);
  visit("beta", boost.beta);
  visit("tau_d", boost.tau_d);
  visit("views", boost.views);
  visit("tau", boost.tau);
  visit("lambda_dssim", boost.lambda_dssim);
  visit("gradient_threshold", boost.gradient_threshold);
  visit("gradient_abs_threshold", boost.gradient_abs_threshold);
  visit("percent_dense", boost.percent_dense);
  visit("densify_from", boost.densify_from);
  visit("densify_until", boost.densify_until);
  visit("densify_interval", boost.densify_interval);
  visit("growth_after_reset", boost.growth_after_reset);
  visit("late_prune_from", boost.late_prune_from);
  visit("late_prune_interval", boost.late_prune_interval);
  visit("late_min_opacity", boost.late_min_opacity);
  visit("late_max_score", boost.late_max_score);
  visit("late_share", boost.late_share);
  visit("coarse", boost.coarse);
  visit("coarse_until", boost.coarse_until);
}

/// Throws ArgumentError that names the setting unless all values are possible.
void check(const VanillaBoost& boost);

/// The paper's text and numbers (supplement, Sec. 9.1). Where phases of the run begin and end scales with its length.
VanillaBoost literal_boost();

/// Where the paper's growth ends and its late pruning begins.
inline constexpr int kLiteralGrowthEnd = 15000;

/// Fewest growths of a run, so that short ones grow too, but never more often than 3DGS itself, nor in the
/// second half of a run.
inline constexpr int kMinGrowths = 12;
inline constexpr int kMinGrowthInterval = 100;

/// The device is where views are scored; statistics and decisions lie in memory of the host.
class VanillaAdapter : public Adapter {
 public:
  /// @param device the backbone's
  VanillaAdapter(const VanillaBoost& boost, Device device);

  std::optional<float> beta() const override;

  bool needs_absolute_gradients() const override;
  bool grows_at(Moment moment, bool backbone_would) const override;
  void grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) override;
  bool prunes_at(Moment moment, bool backbone_would) const override;
  void prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) override;
  /// As the backbone would, while growth_after_reset iterations are left to the end of growth and to late pruning: a
  /// reset is for the pruning that belongs to growth, and what was only just reset would be taken for faint.
  bool resets_opacities_at(Moment moment, bool backbone_would) const override;
  bool steps_at(std::string_view group, Moment moment) const override;

 protected:
  bool is_literal() const { return boost_.literal; }
  int views() const { return boost_.views; }
  /// Scores the primitives over K views; valid until the next call. @param losses whether E_j is wanted
  virtual const ScoreSums& score(RasterizerHook& rasterizer, bool losses, const RandomStream& random);
  /// Mean absolute gradient, in NDC as DensityStatistics::gradients_abs, from which a large Gaussian is split.
  /// @param views the backbone's training views
  virtual double split_threshold(std::size_t views) const {
    (void)views;
    return boost_.gradient_abs_threshold;
  }
  /// Whether growth has just ended and late pruning begins. Never literally.
  virtual bool growth_ended_at(Moment moment) const {
    return !boost_.literal && moment.iteration == late_begin(moment);
  }
  virtual bool prunes_late_at(Moment moment) const;
  int at(int published, Moment moment) const {
    return scaled_iteration(published, moment.total, boost_.published_iterations);
  }
  const VanillaBoost& boost() const { return boost_; }

 private:
  /// What Σ_j n_ij must exceed where something grows, of the views scored last.
  double importance_to_exceed(int views) const;
  /// The first iteration at which nothing grows any more.
  int growth_end(Moment moment) const;
  /// The first iteration of late pruning.
  int late_begin(Moment moment) const;

  VanillaBoost boost_;
  MultiViewScorer scorer_;
  BlendingWeights weights_;
  std::vector<float> pruning_;  ///< of the primitives as they were at the last scoring
  int scored_at_ = -1;          ///< iteration of that scoring
};

}  // namespace splatboost

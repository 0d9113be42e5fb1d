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

/// The parts and constants of the method. Iteration numbers refer to the published run (30 000) and scale with length.
struct VanillaBoost {
  /// Only the paper's rules: τ_d counts whole pixels at any image size, growth and optimizer steps use the paper's
  /// intervals at any run length, gradient thresholds are not scaled, and the backbone decides on opacity resets.
  bool literal = false;
  bool vcd = true;       ///< multi-view consistent densification
  bool vcp = true;       ///< multi-view consistent pruning
  bool cb = true;        ///< compact box
  bool absgrad = true;   ///< split on absolute gradients
  bool schedule = true;  ///< optimizer schedule
  /// With the schedule, the coefficients of higher SH bands step at most every so many iterations, on the sum of the
  /// gradients, also in short runs; 1: as scaled. Not in the paper.
  int rest_interval = 4;
  /// Factor on their learning rate, with the schedule, where views are used often; the paper's release has the same.
  double rest_rate = 2;
  /// The same where views are used seldom (scaled_rules.h): colours then follow the view direction sooner, and have no
  /// time to fit each training view. Not in the paper.
  double rest_rate_few = 4;
  float beta = 0.5f;
  double tau_d = 5;  ///< growth needs τ_d + 1 flagged pixels per view; fewer if views have less than kTauDPixels
  int views = 10;    ///< K
  float tau = 0.1f;  ///< error threshold
  float lambda_dssim = 0.2f;
  double gradient_threshold = 2e-4;      ///< clone
  double gradient_abs_threshold = 6e-4;  ///< split; paper: 1.2e-3
  double percent_dense = 0.001;          ///< × scene extent: Gaussians up to this scale clone, larger split
  int densify_from = 500;
  /// End of growth; later in a short run that would otherwise grow fewer than kMinGrowths times. 0: no growth. Paper:
  /// 15 000.
  int densify_until = 7500;
  /// Iterations between growths (VCD), as in 3DGS; paper: 500. Not scaled, because the gradient statistics need this
  /// many views, but reduced, to no less than kMinGrowthInterval, in runs that would grow fewer than kMinGrowths times.
  int densify_interval = 100;
  /// Opacities are reset only if at least this many iterations of growth follow: never, if the run is not longer than
  /// four published ones. Not scaled, because opacities recover at a rate that does not depend on the run's length.
  int growth_after_reset = 30000;
  /// The initial points were drawn at random (clearance.h), so that free space around the cameras is not known. Then
  /// growth_after_reset is at most kGrowthAfterResetRandom: resets remove what the random points leave there. Given by
  /// the run if min_clearance is not 0.
  bool random_points = false;
  /// Number of training views, given by the run; 0: not known, and rest_rate applies.
  int training_views = 0;
  /// The rate of means, which the backbone sets × the scene extent, follows the distance to the scene where that is
  /// much larger (scaled_rules.h), as for photos from one side. Not in the paper.
  bool rate_by_depth = true;
  /// Typical depth of the scene in its views / its extent, given by the run; 0: not known.
  double depth_ratio = 0;
  int late_prune_from = 7500;  ///< but not before growth has ended; paper: 15 000
  int late_prune_interval = 3000;
  double late_min_opacity = 0.1;
  double late_max_score = 0.9;
  /// Pruning scores are shares of all errors of the scored views, not relative to the other primitives. For blocks of
  /// one scene that are trained separately: a Gaussian's score does not depend on the block. Not in the paper.
  bool absolute_scores = false;
  /// Once, when growth has ended: removes the Gaussians with the smallest blending weights whose weights together are
  /// at most this share of the total. Not in the paper.
  double late_share = 0.05;
  /// The same in a run from random points on photos with a background (kBackgroundShare), which has few Gaussians when
  /// growth ends. Not in the paper.
  double late_share_random = 0;
  /// Each growth also removes Gaussians that are large in the world, as the backbone's own rule says; the sky and walls
  /// without texture are among them. Without VCP it is the backbone that decides. Paper: on.
  bool prune_large = false;
  /// Removes Gaussians with a smaller clearance from the training cameras (clearance.h): a camera has free space around
  /// it, so they are floaters, which hide the scene from new views near there. Not in the paper.
  double min_clearance = 0.8;
  /// Under a cap that growth has reached: each growth but the last also removes the Gaussians with the smallest
  /// blending weights whose weights together are at most this share of the total, so that the next growth can use their
  /// places (measuring them takes 50 renders, about 5% of the run's time), and nothing is removed late, because the cap
  /// is the size that the user wants. 0: a cap changes nothing else. Not in the paper.
  double replaced_share = 0.01;
  /// The parameters of the last share of the run are averaged, where the backbone does that. 0: not. Not in the paper.
  double average_share = 0.05;
  /// An in-tree trainer starts with half-size views. Not in the paper.
  bool coarse = false;        ///< off: growth in the first iterations needs full-size views
  double coarse_until = 0.3;  ///< until this share of the run
  /// An in-tree trainer adds points that it triangulates from the photos where the dataset has none. Not in the paper.
  bool fill_gaps = true;

  // Not user settings: given by the run and by the backbone.
  std::uint64_t seed = 0;
  int published_iterations = kPublishedIterations;  ///< length of the run that iteration numbers refer to
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
  visit("rest_interval", boost.rest_interval);
  visit("rest_rate", boost.rest_rate);
  visit("rest_rate_few", boost.rest_rate_few);
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
  visit("random_points", boost.random_points);
  visit("training_views", boost.training_views);
  visit("rate_by_depth", boost.rate_by_depth);
  visit("depth_ratio", boost.depth_ratio);
  visit("late_prune_from", boost.late_prune_from);
  visit("late_prune_interval", boost.late_prune_interval);
  visit("late_min_opacity", boost.late_min_opacity);
  visit("late_max_score", boost.late_max_score);
  visit("absolute_scores", boost.absolute_scores);
  visit("late_share", boost.late_share);
  visit("late_share_random", boost.late_share_random);
  visit("prune_large", boost.prune_large);
  visit("min_clearance", boost.min_clearance);
  visit("replaced_share", boost.replaced_share);
  visit("average_share", boost.average_share);
  visit("coarse", boost.coarse);
  visit("coarse_until", boost.coarse_until);
  visit("fill_gaps", boost.fill_gaps);
}

/// Throws ArgumentError, naming the setting, if a value is out of range.
void check(const VanillaBoost& boost);

/// The paper's rules and numbers (supplement, Sec. 9.1). The phases of the run scale with its length.
VanillaBoost literal_boost();

/// Iteration at which the paper's growth ends and its late pruning begins.
inline constexpr int kLiteralGrowthEnd = 15000;

/// Minimum number of growths per run if growth began at iteration 0, so that short runs grow too; but never more often
/// than every kMinGrowthInterval iterations, as 3DGS does, nor in the second half of a run.
inline constexpr int kMinGrowths = 12;
inline constexpr int kMinGrowthInterval = 100;

/// Of a run from random points. An opacity needs about 50 steps to rise from a reset to the threshold of late pruning.
inline constexpr int kGrowthAfterResetRandom = 200;

/// Photos have a background if at least this share of their pixels shows the scene (MultiViewScorer::covered_share()).
inline constexpr double kBackgroundShare = 0.9;

/// Growth has reached a cap if at least this share of it is used; pruning within growth leaves a few places free.
inline constexpr double kReachedCap = 0.9;

/// Views are scored on the device; statistics and decisions are in host memory.
class VanillaAdapter : public Adapter {
 public:
  /// @param device the backbone's
  VanillaAdapter(const VanillaBoost& boost, Device device);

  std::optional<float> beta() const override;

  bool needs_absolute_gradients() const override;
  bool needs_clearances() const override;
  bool needs_weights() const override;
  bool grows_at(Moment moment, bool backbone_would) const override;
  void grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) override;
  bool prunes_at(Moment moment, bool backbone_would) const override;
  void prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) override;
  bool prunes_large_at(Moment moment, bool backbone_would) const override;
  /// As the backbone would, but not within growth_after_reset iterations before the end of growth or late pruning:
  /// resets serve the pruning within growth, and late pruning would remove Gaussians whose opacity has not recovered.
  bool resets_opacities_at(Moment moment, bool backbone_would) const override;
  bool steps_at(std::string_view group, Moment moment) const override;
  bool averages_at(Moment moment) const override;
  float rate_factor(std::string_view group, Moment moment) const override;

 protected:
  bool is_literal() const { return boost_.literal; }
  int views() const { return boost_.views; }
  /// Scores the primitives over K views; valid until the next call. @param losses whether to compute E_j too
  virtual const ScoreSums& score(RasterizerHook& rasterizer, bool losses, const RandomStream& random);
  /// Threshold on DensityStatistics::gradients_abs (NDC units) from which a large Gaussian is split.
  /// @param views number of the backbone's training views
  virtual double split_threshold(std::size_t views) const {
    (void)views;
    return boost_.gradient_abs_threshold;
  }
  /// Whether growth has just ended and late pruning begins. Always false with the literal rules.
  virtual bool growth_ended_at(Moment moment) const {
    return !boost_.literal && moment.iteration == late_begin(moment);
  }
  virtual bool prunes_late_at(Moment moment) const;
  /// The first iteration without growth.
  virtual int growth_end(Moment moment) const;
  int at(int published, Moment moment) const {
    return scaled_iteration(published, moment.total, boost_.published_iterations);
  }
  const VanillaBoost& boost() const { return boost_; }

 private:
  /// Prunes by VCP, at the end of each growth and late.
  void prune_by_scores(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions);
  /// Computes pruning_ from the views scored last.
  void compute_pruning_scores(const ScoreSums& sums);
  /// The share of the blending weights to remove when growth has ended, after views were scored.
  double late_share() const;
  /// The threshold that Σ_j n_ij over the views scored last must exceed for growth.
  double importance_to_exceed(int views) const;
  /// Iterations between growths.
  int growth_interval(Moment moment) const;
  /// Whether the rule for caps is on and this many primitives have reached the cap.
  bool reaches_cap(const DensityStatistics& statistics, std::size_t primitives) const;
  /// Whether this growth reaches the cap and another one follows.
  bool makes_room(const DensityStatistics& statistics, const GrowDecisions& decisions) const;
  /// The first iteration of late pruning.
  int late_begin(Moment moment) const;

  VanillaBoost boost_;
  MultiViewScorer scorer_;
  BlendingWeights weights_;
  std::vector<float> pruning_;  ///< [N] pruning scores of the primitives at the last scoring
  int scored_at_ = -1;          ///< iteration of that scoring
  /// [N] blending weights of the primitives before the last growth (some hosts cannot render between growth and
  /// pruning); empty unless that growth makes room for the next one
  std::vector<double> weights_before_growth_;
};

}  // namespace splatboost

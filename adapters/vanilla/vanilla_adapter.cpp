// SPDX-License-Identifier: Apache-2.0
#include "vanilla/vanilla_adapter.h"

#include <algorithm>
#include <cmath>

#include "registry/boost_settings.h"
#include "splatboost/errors.h"
#include "splatboost/select.h"
#include "vanilla/pruning_rules.h"

namespace splatboost {
void check(const VanillaBoost& boost) {
  const auto not_negative = [](double value, const char* reason) {
    check_setting(value >= 0 && std::isfinite(value), reason);
  };
  check_setting(boost.beta > 0 && boost.beta <= 1, "beta must be in (0, 1]");
  not_negative(boost.tau_d, "tau_d must be at least 0");
  check_setting(boost.rest_interval >= 1, "rest_interval must be at least 1");
  not_negative(boost.rest_rate, "rest_rate must be at least 0");
  not_negative(boost.rest_rate_few, "rest_rate_few must be at least 0");
  check_setting(boost.training_views >= 0, "training_views must be at least 0");
  check_setting(boost.depth_ratio >= 0, "depth_ratio must be at least 0");
  check_setting(boost.views >= 1, "views must be at least 1");
  check_setting(boost.tau > 0 && boost.tau < 1, "tau must be in (0, 1)");
  check_setting(boost.lambda_dssim >= 0 && boost.lambda_dssim <= 1, "lambda_dssim must be in [0, 1]");
  not_negative(boost.gradient_threshold, "gradient_threshold must be at least 0");
  not_negative(boost.gradient_abs_threshold, "gradient_abs_threshold must be at least 0");
  not_negative(boost.percent_dense, "percent_dense must be at least 0");
  check_setting(boost.densify_from >= 0, "densify_from must be at least 0");
  check_setting(boost.densify_until >= 0, "densify_until must be at least 0");
  check_setting(boost.densify_interval >= 1, "densify_interval must be at least 1");
  check_setting(boost.growth_after_reset >= 0, "growth_after_reset must be at least 0");
  check_setting(boost.late_prune_from >= 0, "late_prune_from must be at least 0");
  check_setting(boost.late_prune_interval >= 1, "late_prune_interval must be at least 1");
  check_setting(boost.late_min_opacity >= 0 && boost.late_min_opacity <= 1, "late_min_opacity must be in [0, 1]");
  check_setting(boost.late_max_score >= 0 && boost.late_max_score <= 1, "late_max_score must be in [0, 1]");
  check_setting(boost.late_share >= 0 && boost.late_share < 1, "late_share must be in [0, 1)");
  check_setting(boost.late_share_random >= 0 && boost.late_share_random < 1, "late_share_random must be in [0, 1)");
  not_negative(boost.min_clearance, "min_clearance must be at least 0");
  check_setting(boost.replaced_share >= 0 && boost.replaced_share < 1, "replaced_share must be in [0, 1)");
  check_setting(boost.average_share >= 0 && boost.average_share < 1, "average_share must be in [0, 1)");
  check_setting(boost.coarse_until >= 0 && boost.coarse_until <= 1, "coarse_until must be in [0, 1]");
}

VanillaBoost literal_boost() {
  VanillaBoost boost;
  boost.literal = true;
  boost.rest_interval = 1;
  boost.rest_rate = boost.rest_rate_few = 1;
  boost.gradient_abs_threshold = 1.2e-3;
  boost.densify_until = kLiteralGrowthEnd;
  boost.densify_interval = 500;
  boost.late_prune_from = kLiteralGrowthEnd;
  boost.late_share = 0;
  boost.prune_large = true;
  boost.min_clearance = 0;
  boost.replaced_share = 0;
  boost.average_share = 0;
  boost.rate_by_depth = false;
  boost.coarse = false;
  boost.fill_gaps = false;
  return boost;
}

VanillaAdapter::VanillaAdapter(const VanillaBoost& boost, Device device)
    : boost_(boost), scorer_(device), weights_(device) {
  check(boost);
}

std::optional<float> VanillaAdapter::beta() const {
  return boost_.cb ? std::optional<float>(boost_.beta) : std::nullopt;
}

bool VanillaAdapter::needs_absolute_gradients() const { return boost_.absgrad; }

bool VanillaAdapter::needs_clearances() const { return boost_.min_clearance > 0; }

bool VanillaAdapter::needs_weights() const {
  return boost_.vcp && (std::max(boost_.late_share, boost_.late_share_random) > 0 || boost_.replaced_share > 0);
}

bool VanillaAdapter::grows_at(Moment moment, bool backbone_would) const {
  if (!boost_.vcd) return backbone_would;
  const int from = at(boost_.densify_from, moment);
  return moment.iteration > from && moment.iteration < growth_end(moment) &&
         moment.iteration % growth_interval(moment) == 0;
}

int VanillaAdapter::growth_interval(Moment moment) const {
  if (boost_.literal) return boost_.densify_interval;
  return std::min(boost_.densify_interval, std::max(kMinGrowthInterval, growth_end(moment) / kMinGrowths));
}

bool VanillaAdapter::reaches_cap(const DensityStatistics& statistics, std::size_t primitives) const {
  return boost_.vcd && boost_.replaced_share > 0 && statistics.max_primitives > 0 &&
         static_cast<double>(primitives) >= kReachedCap * static_cast<double>(statistics.max_primitives);
}

const ScoreSums& VanillaAdapter::score(RasterizerHook& rasterizer, bool losses, const RandomStream& random) {
  return scorer_.score(rasterizer, {boost_.views, boost_.tau, boost_.lambda_dssim, losses}, random);
}

void VanillaAdapter::grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) {
  const std::size_t n = decisions.clone.size();
  SPLATBOOST_CHECK(decisions.split.size() == n, "clone and split must have the same size");
  SPLATBOOST_CHECK(!boost_.absgrad || (statistics.gradients.size() == n && statistics.gradients_abs.size() == n &&
                                       statistics.max_scales.size() == n),
                   "growth by absolute gradients needs gradients, gradients_abs and max_scales of all primitives");
  const Moment moment = statistics.moment;
  const RandomStream random(boost_.seed, static_cast<std::uint64_t>(moment.iteration), RandomPurpose::scored_views);
  double gradient_scale = 1;
  const ScoreSums* sums = nullptr;
  weights_before_growth_.clear();
  if (boost_.vcd || boost_.vcp) {
    sums = &score(rasterizer, boost_.vcp, random);
    if (boost_.vcp) compute_pruning_scores(*sums);
    scored_at_ = moment.iteration;
    if (!boost_.literal) gradient_scale = std::sqrt(scorer_.covered_share());
  }
  if (boost_.absgrad) {
    const auto border = static_cast<float>(boost_.percent_dense * static_cast<double>(statistics.scene_extent));
    const auto clone_from = static_cast<float>(boost_.gradient_threshold * gradient_scale);
    const auto split_from = static_cast<float>(split_threshold(rasterizer.scorable_views()) * gradient_scale);
    for (std::size_t i = 0; i < n; ++i) {
      const bool small = statistics.max_scales[i] <= border;
      decisions.clone[i] = small && statistics.gradients[i] >= clone_from;
      decisions.split[i] = !small && statistics.gradients_abs[i] >= split_from;
      if (!decisions.priorities.empty()) {
        decisions.priorities[i] = small ? growth_priority(statistics.gradients[i], clone_from)
                                        : growth_priority(statistics.gradients_abs[i], split_from);
      }
    }
  }
  if (boost_.vcd) {
    const double below = importance_to_exceed(sums->views);
    keep_important(sums->counts, below, decisions.clone);
    keep_important(sums->counts, below, decisions.split);
  }
  if (makes_room(statistics, decisions)) {
    const std::span<const double> weights = weights_.mean(rasterizer, kWeighedViews, random);
    weights_before_growth_.assign(weights.begin(), weights.end());
  }
}

bool VanillaAdapter::makes_room(const DensityStatistics& statistics, const GrowDecisions& decisions) const {
  const Moment moment = statistics.moment;
  if (!boost_.vcp || growth_interval(moment) >= growth_end(moment) - moment.iteration) return false;
  std::size_t grown = decisions.clone.size();
  for (std::size_t i = 0; i < decisions.clone.size(); ++i) grown += decisions.clone[i] != 0 || decisions.split[i] != 0;
  return reaches_cap(statistics, grown);
}

void VanillaAdapter::compute_pruning_scores(const ScoreSums& sums) {
  pruning_.resize(sums.counts.size());
  if (boost_.absolute_scores) {
    absolute_pruning_scores(sums, pruning_);
  } else {
    pruning_scores(sums, pruning_);
  }
}

double VanillaAdapter::importance_to_exceed(int views) const {
  // ⌊Σ_j n_ij / K⌋ > τ_d requires a mean of at least ⌊τ_d⌋ + 1.
  if (boost_.literal) return (std::floor(boost_.tau_d) + 1) * std::max(1, views) - 1;
  return splatboost::importance_to_exceed(boost_.tau_d + 1, scorer_.mean_pixels(), views);
}

int VanillaAdapter::growth_end(Moment moment) const {
  const int until = at(boost_.densify_until, moment);
  if (boost_.literal || boost_.densify_until == 0) return until;
  const int published = std::min(at(kLiteralGrowthEnd, moment), moment.total / 2);
  if (!boost_.vcd) return std::max(until, published);  // the backbone decides
  const std::int64_t enough = std::int64_t{at(boost_.densify_from, moment)} + kMinGrowths * kMinGrowthInterval + 1;
  // An early end that was asked for is kept: growth is at most as long as in the published run, not scaled.
  const int longest = boost_.densify_from < boost_.densify_until ? boost_.densify_until : published;
  return std::max(until, static_cast<int>(std::min<std::int64_t>({enough, published, longest})));
}

int VanillaAdapter::late_begin(Moment moment) const {
  const int from = at(boost_.late_prune_from, moment);
  return boost_.literal ? from : std::max(from, growth_end(moment));
}

bool VanillaAdapter::prunes_late_at(Moment moment) const {
  if (!boost_.vcp) return false;
  if (growth_ended_at(moment)) return moment.iteration < moment.total;
  return late_pruning_recurs_at(moment, late_begin(moment), at(boost_.late_prune_interval, moment));
}

bool VanillaAdapter::prunes_at(Moment moment, bool backbone_would) const {
  return backbone_would || prunes_late_at(moment);
}

void VanillaAdapter::prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) {
  if (boost_.vcp) prune_by_scores(statistics, rasterizer, decisions);
  if (!needs_clearances() || statistics.clearances.empty()) return;
  SPLATBOOST_CHECK(statistics.clearances.size() == decisions.remove.size(),
                   "clearances must have one number per primitive");
  for (std::size_t i = 0; i < statistics.clearances.size(); ++i) {
    if (statistics.clearances[i] < static_cast<float>(boost_.min_clearance)) decisions.remove[i] = 1;
  }
}

void VanillaAdapter::prune_by_scores(const DensityStatistics& statistics, RasterizerHook& rasterizer,
                                     PruneDecisions& decisions) {
  const std::size_t n = decisions.remove.size();
  const auto iteration = static_cast<std::uint64_t>(statistics.moment.iteration);
  if (decisions.rule == PruneRule::growth) {
    SPLATBOOST_CHECK(scored_at_ == statistics.moment.iteration, "pruning within growth needs a grow() before it");
    remove_half_of_candidates(pruning_, RandomStream(boost_.seed, iteration, RandomPurpose::prune), decisions);
    if (weights_before_growth_.empty()) return;
    std::vector<double> blended(n);
    for (std::size_t i = 0; i < n; ++i) blended[i] = weights_before_growth_[decisions.origins[i]];
    select_least(blended, boost_.replaced_share, decisions.remove);
    return;
  }
  if (decisions.rule != PruneRule::late || !prunes_late_at(statistics.moment)) return;
  if (reaches_cap(statistics, n) && n <= statistics.max_primitives) return;  // above it: begun with more than the cap
  const RandomStream random(boost_.seed, iteration, RandomPurpose::scored_views);
  scored_at_ = -1;  // the scores are no longer those of a growth
  compute_pruning_scores(score(rasterizer, true, random));
  const double settled = boost_.literal ? 1 : settled_share(statistics.moment, rasterizer.scorable_views());
  remove_late(statistics, pruning_, static_cast<float>(boost_.late_min_opacity * settled),
              static_cast<float>(boost_.late_max_score), decisions);
  if (late_share() <= 0 || !growth_ended_at(statistics.moment)) return;
  select_least(weights_.mean(rasterizer, kWeighedViews, random), late_share() * settled, decisions.remove);
}

double VanillaAdapter::late_share() const {
  const bool background = scorer_.covered_share() >= kBackgroundShare;
  return boost_.random_points && background ? boost_.late_share_random : boost_.late_share;
}

bool VanillaAdapter::prunes_large_at(Moment, bool backbone_would) const {
  return backbone_would && (boost_.prune_large || !boost_.vcp);
}

bool VanillaAdapter::resets_opacities_at(Moment moment, bool backbone_would) const {
  if (boost_.literal) return backbone_would;
  const int growth_after =
      boost_.random_points ? std::min(boost_.growth_after_reset, kGrowthAfterResetRandom) : boost_.growth_after_reset;
  const std::int64_t recovered = std::int64_t{moment.iteration} + growth_after;
  if (boost_.vcd && recovered > growth_end(moment)) return false;
  if (boost_.vcp && recovered > late_begin(moment)) return false;
  return backbone_would;
}

bool VanillaAdapter::steps_at(std::string_view group, Moment moment) const {
  if (!boost_.schedule || moment.iteration >= moment.total) return true;
  const bool rest = group == kHigherBands;
  const StepIntervals& intervals = rest ? kRestIntervals : kOtherIntervals;
  if (boost_.literal) return steps_literally_at(intervals, moment, boost_.published_iterations);
  const int scaled = step_interval(intervals, moment, boost_.published_iterations);
  return moment.iteration % std::max(scaled, rest ? boost_.rest_interval : 1) == 0;
}

bool VanillaAdapter::averages_at(Moment moment) const { return splatboost::averages_at(boost_.average_share, moment); }

float VanillaAdapter::rate_factor(std::string_view group, Moment moment) const {
  if (group == kMeans && boost_.rate_by_depth) return static_cast<float>(rate_of_depth(boost_.depth_ratio));
  if (!boost_.schedule || boost_.literal || group != kHigherBands) return 1.0f;
  return static_cast<float>(higher_bands_rate(boost_.rest_rate_few, boost_.rest_rate, moment, boost_.training_views));
}

AdapterEntry vanilla_adapter_entry() {
  return {"vanilla",
          [](bool literal) { return make_settings<VanillaAdapter>(literal ? literal_boost() : VanillaBoost{}); }};
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "convex_splatting/convex_adapter.h"

#include <algorithm>
#include <cmath>

#include "registry/boost_settings.h"
#include "splatboost/errors.h"
#include "splatboost/hooks.h"
#include "splatboost/select.h"
#include "vanilla/pruning_rules.h"
#include "vanilla/scaled_rules.h"

namespace splatboost {
void check(const ConvexBoost& boost) {
  check_setting(boost.beta > 0 && boost.beta <= 1, "beta must be in (0, 1]");
  check_setting(boost.tau_d >= 0 && std::isfinite(boost.tau_d), "tau_d must be at least 0");
  check_setting(boost.views >= 1, "views must be at least 1");
  check_setting(boost.tau > 0 && boost.tau < 1, "tau must be in (0, 1)");
  check_setting(boost.lambda_dssim >= 0 && boost.lambda_dssim <= 1, "lambda_dssim must be in [0, 1]");
  check_setting(boost.late_prune_from >= 0, "late_prune_from must be at least 0");
  check_setting(boost.late_prune_interval >= 1, "late_prune_interval must be at least 1");
  check_setting(boost.late_min_opacity >= 0 && boost.late_min_opacity <= 1, "late_min_opacity must be in [0, 1]");
  check_setting(boost.late_max_score >= 0 && boost.late_max_score <= 1, "late_max_score must be in [0, 1]");
  check_setting(boost.late_share >= 0 && boost.late_share < 1, "late_share must be in [0, 1)");
  check_setting(boost.average_share >= 0 && boost.average_share < 1, "average_share must be in [0, 1)");
  check_setting(boost.coarse_until >= 0 && boost.coarse_until <= 1, "coarse_until must be in [0, 1]");
  check_setting(boost.rest_rate >= 0 && std::isfinite(boost.rest_rate), "rest_rate must be at least 0");
  check_setting(boost.rest_rate_few >= 0 && std::isfinite(boost.rest_rate_few), "rest_rate_few must be at least 0");
  check_setting(boost.training_views >= 0, "training_views must be at least 0");
}

ConvexBoost literal_convex_boost() {
  ConvexBoost boost;
  boost.literal = true;
  boost.schedule = false;
  boost.beta = 0.5f;
  boost.late_prune_from = 15000;
  boost.late_min_opacity = 0.1;
  boost.late_share = 0;
  boost.average_share = 0;
  boost.track_points = false;
  boost.scale_lengths = false;
  return boost;
}

ConvexAdapter::ConvexAdapter(const ConvexBoost& boost, Device device)
    : boost_(boost), scorer_(device), weights_(device) {
  check(boost);
}

std::optional<float> ConvexAdapter::beta() const {
  return boost_.cb ? std::optional<float>(boost_.beta) : std::nullopt;
}

const ScoreSums& ConvexAdapter::score(Moment moment, RasterizerHook& rasterizer) {
  const RandomStream random(boost_.seed, static_cast<std::uint64_t>(moment.iteration), RandomPurpose::scored_views);
  const ScoreSums& sums =
      scorer_.score(rasterizer, {boost_.views, boost_.tau, boost_.lambda_dssim, boost_.vcp}, random);
  if (boost_.vcp) {
    pruning_.resize(rasterizer.primitives());
    pruning_scores(sums, pruning_);
  }
  return sums;
}

void ConvexAdapter::grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) {
  if (!boost_.vcd && !boost_.vcp) return;
  const ScoreSums& sums = score(statistics.moment, rasterizer);
  scored_at_ = statistics.moment.iteration;
  if (!boost_.vcd) return;
  if (boost_.literal) {
    importance_.resize(rasterizer.primitives());
    importance_scores(sums, importance_);
    keep_important(importance_, boost_.tau_d, decisions.split);
    return;
  }
  // The least count, one pixel per view, is for each added convex too: as if K were that many times larger.
  const double least = importance_to_exceed(boost_.tau_d + 1, scorer_.mean_pixels(), kAddedByASplit * sums.views);
  keep_important(sums.counts, least, decisions.split);
}

bool ConvexAdapter::growth_ended_at(Moment moment) const {
  return !boost_.literal && moment.iteration == scaled_iteration(boost_.late_prune_from, moment.total);
}

bool ConvexAdapter::prunes_late_at(Moment moment) const {
  if (!boost_.vcp) return false;
  if (growth_ended_at(moment)) return moment.iteration < moment.total;
  return late_pruning_recurs_at(moment, scaled_iteration(boost_.late_prune_from, moment.total),
                                scaled_iteration(boost_.late_prune_interval, moment.total));
}

bool ConvexAdapter::prunes_at(Moment moment, bool backbone_would) const {
  return backbone_would || prunes_late_at(moment);
}

void ConvexAdapter::prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) {
  if (!boost_.vcp) return;
  const auto iteration = static_cast<std::uint64_t>(statistics.moment.iteration);
  if (decisions.rule == PruneRule::growth) {
    SPLATBOOST_CHECK(scored_at_ == statistics.moment.iteration, "pruning within growth needs a grow() before it");
    remove_half_of_candidates(pruning_, RandomStream(boost_.seed, iteration, RandomPurpose::prune), decisions);
    return;
  }
  if (decisions.rule != PruneRule::late || !prunes_late_at(statistics.moment)) return;
  scored_at_ = -1;  // the scores are no longer those of a growth
  score(statistics.moment, rasterizer);
  const double settled = boost_.literal ? 1 : settled_share(statistics.moment, rasterizer.scorable_views());
  remove_late(statistics, pruning_, static_cast<float>(boost_.late_min_opacity * settled),
              static_cast<float>(boost_.late_max_score), decisions);
  if (boost_.late_share <= 0 || !growth_ended_at(statistics.moment)) return;
  const RandomStream random(boost_.seed, iteration, RandomPurpose::scored_views);
  select_least(weights_.mean(rasterizer, kWeighedViews, random), boost_.late_share * settled, decisions.remove);
}

bool ConvexAdapter::steps_at(std::string_view group, Moment moment) const {
  return !boost_.schedule || splatboost::steps_at(group == kHigherBands ? kRestIntervals : kOtherIntervals, moment);
}

bool ConvexAdapter::averages_at(Moment moment) const { return splatboost::averages_at(boost_.average_share, moment); }

float ConvexAdapter::rate_factor(std::string_view group, Moment moment) const {
  if (!boost_.schedule || boost_.literal || group != kHigherBands) return 1.0f;
  return static_cast<float>(higher_bands_rate(boost_.rest_rate_few, boost_.rest_rate, moment, boost_.training_views));
}

AdapterEntry convex_splatting_adapter_entry() {
  return {"convex-splatting",
          [](bool literal) { return make_settings<ConvexAdapter>(literal ? literal_convex_boost() : ConvexBoost{}); }};
}

}  // namespace splatboost

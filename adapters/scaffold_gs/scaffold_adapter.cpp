// SPDX-License-Identifier: Apache-2.0
#include "scaffold_gs/scaffold_adapter.h"

#include <algorithm>

#include "splatboost/errors.h"
#include "splatboost/select.h"

namespace splatboost {

ScaffoldAdapter::ScaffoldAdapter(const ScaffoldBoost& boost, Device device)
    : boost_(boost), device_(device), scorer_(device) {
  SPLATBOOST_CHECK(boost.beta > 0.0f && boost.beta <= 1.0f, "beta must lie in (0, 1]");
  SPLATBOOST_CHECK(boost.views > 0, "views must be above 0");
}

std::optional<float> ScaffoldAdapter::beta() const {
  return boost_.cb ? std::optional<float>(boost_.beta) : std::nullopt;
}

double ScaffoldAdapter::tau_d_for(std::span<const std::int64_t> importance) const {
  std::int64_t sum = 0;
  std::size_t counted = 0;
  for (const std::int64_t value : importance) {
    sum += value;
    counted += value > 0 ? 1 : 0;
  }
  const double mean = counted > 0 ? static_cast<double>(sum) / static_cast<double>(counted) : 0.0;
  return boost_.tau_d * std::max(1.0, mean / boost_.mean_importance);
}

const ScoreSums& ScaffoldAdapter::sums(RasterizerHook& rasterizer, const RandomStream& random) {
  MultiViewOptions options;
  options.views = boost_.views;
  options.tau = boost_.tau;
  return scorer_.score(rasterizer, options, random);
}

void ScaffoldAdapter::score(RasterizerHook& rasterizer, const RandomStream& random,
                            std::vector<std::int64_t>& importance) {
  importance.resize(rasterizer.primitives());
  importance_scores(sums(rasterizer, random), importance);
}

void ScaffoldAdapter::grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) {
  // Without a candidate there is nothing to gate, and nothing to draw K views for.
  const bool any =
      std::any_of(decisions.clone.begin(), decisions.clone.end(), [](std::uint8_t wants) { return wants != 0; });
  if (!boost_.vcd || !any) return;
  const auto iteration = static_cast<std::uint64_t>(statistics.moment.iteration);
  score(rasterizer, RandomStream(boost_.seed, iteration, RandomPurpose::scored_views), importance_);
  keep_important(importance_, tau_d_for(importance_), decisions.clone);
}

}  // namespace splatboost

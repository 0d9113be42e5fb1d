// SPDX-License-Identifier: Apache-2.0
#include "vanilla/pruning_rules.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "splatboost/errors.h"
#include "splatboost/select.h"

namespace splatboost {

void remove_half_of_candidates(std::span<const float> scores, const RandomStream& random, PruneDecisions& decisions) {
  const std::size_t n = decisions.remove.size();
  SPLATBOOST_CHECK(decisions.origins.size() == n, "pruning within growth needs the origin of each primitive");
  std::vector<float> weights(n);
  for (std::size_t i = 0; i < n; ++i) {
    SPLATBOOST_CHECK(decisions.origins[i] < scores.size(), "an origin is not a primitive of the last growth");
    weights[i] = scores[decisions.origins[i]];
  }
  const auto candidates = static_cast<std::size_t>(
      std::count_if(decisions.remove.begin(), decisions.remove.end(), [](std::uint8_t r) { return r != 0; }));
  keep_weighted_sample(weights, candidates / 2, random, decisions.remove);
}

bool late_pruning_recurs_at(Moment moment, int begin, int interval) {
  return moment.iteration > begin && interval / 10 < moment.total - moment.iteration &&
         moment.iteration % interval == 0;
}

void remove_late(const DensityStatistics& statistics, std::span<const float> scores, float min_opacity, float max_score,
                 PruneDecisions& decisions) {
  const std::size_t n = decisions.remove.size();
  SPLATBOOST_CHECK(statistics.opacities.size() == n, "late pruning needs the opacities");
  SPLATBOOST_CHECK(scores.size() == n, "late pruning needs as many primitives as the rasterizer has");
  for (std::size_t i = 0; i < n; ++i) {
    if (statistics.opacities[i] < min_opacity || scores[i] > max_score) decisions.remove[i] = 1;
  }
}

}  // namespace splatboost

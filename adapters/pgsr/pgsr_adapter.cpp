// SPDX-License-Identifier: Apache-2.0
#include "pgsr/pgsr_adapter.h"

#include <cstddef>
#include <cstdint>
#include <vector>

#include "registry/boost_settings.h"

namespace splatboost {

VanillaBoost pgsr_boost() {
  VanillaBoost boost;
  // Surfaces settle in the second half of a run, where every step counts. The supplement (Sec. 9.2) uses plain Adam.
  boost.schedule = false;
  // Whole splats (β = 1): planes are blended out to a splat's faint rim, and cutting it changes the depth.
  boost.beta = 1;
  // The backbone already selects its growth candidates by absolute gradients too.
  boost.absgrad = false;
  // PGSR's own resets, which serve its pruning within growth. Late pruning begins when growth has ended, and would
  // remove every Gaussian whose opacity was reset shortly before.
  boost.growth_after_reset = 500;
  boost.replaced_share = 0;  // not measured; every run has a cap, PGSR's own
  return boost;
}

void PgsrAdapter::grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) {
  const std::vector<std::uint8_t> clone(decisions.clone.begin(), decisions.clone.end());
  const std::vector<std::uint8_t> split(decisions.split.begin(), decisions.split.end());
  VanillaAdapter::grow(statistics, rasterizer, decisions);
  for (std::size_t i = 0; i < clone.size(); ++i) {
    if (clone[i] == 0) decisions.clone[i] = 0;
    if (split[i] == 0) decisions.split[i] = 0;
  }
}

AdapterEntry pgsr_adapter_entry() {
  return {"pgsr", [](bool literal) {
            VanillaBoost boost = literal ? literal_boost() : pgsr_boost();
            boost.schedule = false;
            return make_settings<PgsrAdapter>(boost);
          }};
}

}  // namespace splatboost

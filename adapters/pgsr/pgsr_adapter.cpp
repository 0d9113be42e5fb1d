// SPDX-License-Identifier: Apache-2.0
#include "pgsr/pgsr_adapter.h"

#include "registry/boost_settings.h"

namespace splatboost {

VanillaBoost pgsr_boost() {
  VanillaBoost boost;
  boost.densify_until = kLiteralGrowthEnd;
  boost.late_prune_from = kLiteralGrowthEnd;
  // Surfaces settle in the second half of a run: every step counts there. The supplement (Sec. 9.2) has plain Adam too.
  boost.schedule = false;
  // Planes reach to where a splat ends: without its faint rim the neighbouring ones blend to another depth.
  boost.beta = 1;
  // The backbone's own candidates for growth are by absolute gradients, too.
  boost.absgrad = false;
  boost.growth_after_reset = 0;
  return boost;
}

AdapterEntry pgsr_adapter_entry() {
  return {"pgsr", [](bool literal) {
            VanillaBoost boost = literal ? literal_boost() : pgsr_boost();
            boost.schedule = false;
            return make_settings<PgsrAdapter>(boost);
          }};
}

}  // namespace splatboost

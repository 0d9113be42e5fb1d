// SPDX-License-Identifier: Apache-2.0
#include "deformable_3dgs/deformable_adapter.h"

#include "registry/boost_settings.h"
#include "splatboost/constants.h"

namespace splatboost {
namespace {

constexpr std::string_view kNet = "deformation";  ///< the backbone's name of the net's parameter group

}  // namespace

VanillaBoost deformable_boost() {
  VanillaBoost boost;
  boost.published_iterations = kDeformableIterations;
  // A quarter of the run, as for vanilla (published: three eighths). Until growth ends there are as many Gaussians as
  // in the published run, and the net is evaluated for each of them.
  boost.densify_until = boost.late_prune_from = kDeformableIterations / 4;
  // Every tenth of the run, as in vanilla. (The published code stops at 27 000, whatever the length of the run.)
  boost.late_prune_interval = kDeformableIterations / 10;
  // The backbone selects its growth candidates by absolute gradients. Vanilla's thresholds would select twice as many.
  boost.absgrad = false;
  boost.growth_after_reset = 3000;  // without resets: -1.0 dB on photos of bird, with their numbers as times
  boost.fill_gaps = false;          // the program adds none to scenes that move
  boost.rate_by_depth = false;      // its rates do not depend on the extent
  // As published. Twice the rate and fewer steps gained 0.1 dB on D-NeRF's lego in one run, which says little.
  boost.rest_interval = 1;
  boost.rest_rate = boost.rest_rate_few = 1;
  return boost;
}

void DeformableAdapter::prune(const DensityStatistics& statistics, RasterizerHook& rasterizer,
                              PruneDecisions& decisions) {
  unseen_.assign(decisions.remove.size(), 0);
  // Hosts may omit opacities where they are not needed.
  const bool known = statistics.opacities.size() == unseen_.size();
  const bool applies = known && !is_literal() && decisions.rule == PruneRule::growth;
  for (std::size_t i = 0; applies && i < unseen_.size(); ++i) {
    unseen_[i] = decisions.remove[i] != 0 && statistics.opacities[i] < kMinAlpha;
    if (unseen_[i] != 0) decisions.remove[i] = 0;
  }
  VanillaAdapter::prune(statistics, rasterizer, decisions);
  for (std::size_t i = 0; i < unseen_.size(); ++i) {
    if (unseen_[i] != 0) decisions.remove[i] = 1;
  }
}

bool DeformableAdapter::steps_at(std::string_view group, Moment moment) const {
  return group == kNet || VanillaAdapter::steps_at(group, moment);
}

AdapterEntry deformable_3dgs_adapter_entry() {
  return {"deformable-3dgs", [](bool literal) {
            VanillaBoost boost = deformable_boost();
            if (literal) {
              boost = literal_boost();
              boost.published_iterations = kDeformableIterations;
              boost.schedule = false;  // plain Adam (supplement, Sec. 9.2)
            }
            return make_settings<DeformableAdapter>(boost);
          }};
}

}  // namespace splatboost

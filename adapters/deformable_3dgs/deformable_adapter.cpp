// SPDX-License-Identifier: Apache-2.0
#include "deformable_3dgs/deformable_adapter.h"

#include "registry/boost_settings.h"

namespace splatboost {
namespace {

constexpr std::string_view kNet = "deformation";  ///< the backbone's group of parameters

}  // namespace

VanillaBoost deformable_boost() {
  VanillaBoost boost;
  boost.published_iterations = kDeformableIterations;
  // As vanilla's, every tenth of the run. (The release stops at 27 000, whatever the length of the run.)
  boost.late_prune_interval = kDeformableIterations / 10;
  // The backbone's own candidates for growth are by absolute gradients. Vanilla's borders make twice as many of them.
  boost.absgrad = false;
  return boost;
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

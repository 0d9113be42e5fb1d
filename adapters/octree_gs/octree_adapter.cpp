// SPDX-License-Identifier: Apache-2.0
#include "octree_gs/octree_adapter.h"

#include "registry/boost_settings.h"

namespace splatboost {

ScaffoldBoost octree_boost() {
  ScaffoldBoost boost;
  boost.beta = 1;                 // the exact box; smaller ones lose quality on a turn around an object
                                  // (docs/results/backbones.md)
  boost.rates_fall_from = 0.625;  // growth ends at 25,000 of 40,000 iterations
  return boost;
}

AdapterEntry octree_gs_adapter_entry() {
  return {"octree-gs", [](bool literal) {
            return make_settings<ScaffoldAdapter>(literal ? literal_scaffold_boost() : octree_boost());
          }};
}

}  // namespace splatboost

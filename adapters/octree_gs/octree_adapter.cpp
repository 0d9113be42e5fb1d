// SPDX-License-Identifier: Apache-2.0
#include "octree_gs/octree_adapter.h"

namespace splatboost {

ScaffoldBoost octree_boost() {
  ScaffoldBoost boost;
  boost.beta = 0.5f;
  return boost;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for Octree-GS: Scaffold-GS's rules, with the exact box and growth that ends later. Error densities
/// need no per-level rule.
#pragma once

#include "scaffold_gs/scaffold_adapter.h"

namespace splatboost {

/// Settings for a ScaffoldAdapter.
ScaffoldBoost octree_boost();

}  // namespace splatboost

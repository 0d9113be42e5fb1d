// SPDX-License-Identifier: Apache-2.0
/// @file Scaffold-GS (Lu et al. 2024) as published, with hooks but without any acceleration.
#pragma once

#include <memory>

#include <nlohmann/json.hpp>

#include "families/anchors/anchor_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// The published defaults; iterations are for a run of 30 000.
struct ScaffoldConfig : AnchorConfig {
  double voxel_size = 0.001;    ///< 0: world units, median over the points of the mean squared distance to 3 neighbours
  int update_depth = 3;         ///< number of grid levels in which anchors grow, the coarsest first
  int update_init_factor = 16;  ///< size of the coarsest cells in voxels
  int update_hierarchy_factor = 4;  ///< per level, cells shrink by this and thresholds rise by half of it
};

nlohmann::json to_json(const ScaffoldConfig& config);
/// The defaults, overridden by the keys in `json`. Throws InputError on an unknown key or an invalid value.
ScaffoldConfig scaffold_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_scaffold(const BackboneContext& context, const ScaffoldConfig& config);

}  // namespace splatboost

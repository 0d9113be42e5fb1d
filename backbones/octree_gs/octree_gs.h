// SPDX-License-Identifier: Apache-2.0
/// @file Octree-GS (Ren et al. 2024) as published, with hooks but without any acceleration.
#pragma once

#include <memory>
#include <string>

#include <nlohmann/json.hpp>

#include "families/anchors/anchor_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// Length of the published run, to which iterations refer.
inline constexpr int kOctreeIterations = 40000;

/// Defaults are those of the release, or of its training scripts where these all use another value.
struct OctreeConfig : AnchorConfig {
  OctreeConfig() { grow_until = 25000; }

  int fork = 2;         ///< cells shrink by this per level
  double extend = 1.1;  ///< scale factor of the box around the points
  int base_layer = -1;  ///< the coarsest cells have size box / fork^base_layer; -1: from the box and the levels
  double visible_threshold = 0;      ///< minimum share of cameras that use an anchor; negative: the initial mean
  double dist_ratio = 0.999;         ///< quantile of the distances taken as the farthest
  int levels = -1;                   ///< -1: from the nearest and farthest distances
  int init_level = -1;               ///< finest level at the start of progressive training; -1: half of the levels
  std::string dist2level = "round";  ///< rounding of levels: round, floor or ceil
  bool progressive = true;           ///< whether finer levels are enabled one after the other
  int coarse_iter = 10000;           ///< iteration from which all levels are enabled
  double coarse_factor = 1.5;        ///< each level's interval is shorter by this than the one before
  double update_ratio = 0.2;         ///< growth thresholds rise by fork^update_ratio per level
  double extra_ratio = 0.25;         ///< × threshold; anchors with a larger mean gradient get a higher extra level
  double extra_up = 0.01;            ///< increment of the extra level
  bool add_level = false;            ///< whether the level is an input of the nets
};

nlohmann::json to_json(const OctreeConfig& config);
/// The defaults, overridden by the keys in `json`. Throws InputError on an unknown key or an invalid value.
OctreeConfig octree_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_octree(const BackboneContext& context, const OctreeConfig& config);

}  // namespace splatboost

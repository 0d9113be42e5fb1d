// SPDX-License-Identifier: Apache-2.0
/// @file Octree-GS (Ren et al. 2024) as published, with hooks and no knowledge of acceleration.
#pragma once

#include <memory>
#include <string>

#include <nlohmann/json.hpp>

#include "families/anchors/anchor_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// Length of the published run, which iteration numbers are of.
inline constexpr int kOctreeIterations = 40000;

/// The constants of the release and, where its training scripts all agree on another value, that one.
struct OctreeConfig : AnchorConfig {
  OctreeConfig() { grow_until = 25000; }

  int fork = 2;         ///< cells shrink by this from level to level
  double extend = 1.1;  ///< of the box around the points
  int base_layer = -1;  ///< the coarsest cells are the box's side / fork^base_layer; -1: from the box and the levels
  double visible_threshold = 0;  ///< share of the cameras that must use an anchor; below 0: the mean share at the start
  double dist_ratio = 0.999;     ///< quantile of the distances that counts as the farthest
  int levels = -1;               ///< -1: from the nearest and farthest distances
  int init_level = -1;           ///< finest level at the start of progressive training; -1: half of the levels
  std::string dist2level = "round";  ///< how a distance becomes a level: round, floor or ceil
  bool progressive = true;           ///< finer levels open one after the other
  int coarse_iter = 10000;           ///< all are open from here on
  double coarse_factor = 1.5;        ///< each level's time is this much shorter than the one before it
  double update_ratio = 0.2;         ///< thresholds of growth rise by fork^update_ratio a level
  double extra_ratio = 0.25;  ///< × threshold: mean gradient of an anchor above which its level is raised in views
  double extra_up = 0.01;     ///< by so much
  bool add_level = false;     ///< whether the nets are told the level
};

nlohmann::json to_json(const OctreeConfig& config);
/// Reads the keys that are there over the defaults. Throws InputError on an unknown key or an impossible value.
OctreeConfig octree_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_octree(const BackboneContext& context, const OctreeConfig& config);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "octree_gs/octree_gs.h"
#include "octree_gs/usable_anchors.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

template <class Config, class Visit>
void for_each_field(Config& c, Visit&& visit) {
  for_each_anchor_field(c, visit);
  visit("fork", c.fork);
  visit("extend", c.extend);
  visit("base_layer", c.base_layer);
  visit("visible_threshold", c.visible_threshold);
  visit("dist_ratio", c.dist_ratio);
  visit("levels", c.levels);
  visit("init_level", c.init_level);
  visit("dist2level", c.dist2level);
  visit("progressive", c.progressive);
  visit("coarse_iter", c.coarse_iter);
  visit("coarse_factor", c.coarse_factor);
  visit("update_ratio", c.update_ratio);
  visit("extra_ratio", c.extra_ratio);
  visit("extra_up", c.extra_up);
  visit("add_level", c.add_level);
}

}  // namespace

nlohmann::json to_json(const OctreeConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

OctreeConfig octree_config_from_json(const nlohmann::json& json) {
  OctreeConfig config;
  fields_from_json(json, "backbone octree-gs", [&](auto&& visit) { for_each_field(config, visit); });
  const std::string what = "config of backbone octree-gs: ";
  check_anchor_config(config, what);
  require(config.fork >= 2 && config.fork <= 16, what + "fork must be 2 to 16");
  require(config.extend >= 1, what + "extend must be at least 1");
  require(config.base_layer >= -1 && config.base_layer <= 30, what + "base_layer must be -1 to 30");
  require(config.visible_threshold < 1, what + "visible_threshold must be below 1");
  require(config.dist_ratio > 0.5 && config.dist_ratio <= 1, what + "dist_ratio must lie in (0.5, 1]");
  require(config.levels == -1 || (config.levels >= 1 && config.levels <= kMaxLevels),
          what + "levels must be -1 or 1 to " + std::to_string(kMaxLevels));
  require(config.init_level >= -1 && config.init_level <= kMaxLevels,
          what + "init_level must be -1 to " + std::to_string(kMaxLevels));
  require(config.dist2level == "round" || config.dist2level == "floor" || config.dist2level == "ceil",
          what + "dist2level must be round, floor or ceil");
  require(config.coarse_iter >= 0, what + "coarse_iter must not be negative");
  require(config.coarse_factor > 1, what + "coarse_factor must be above 1");
  require(config.extra_ratio >= 0 && config.extra_up >= 0, what + "extra_ratio and extra_up must not be negative");
  return config;
}

}  // namespace splatboost

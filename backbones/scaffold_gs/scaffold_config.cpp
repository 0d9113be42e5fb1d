// SPDX-License-Identifier: Apache-2.0
#include "scaffold_gs/scaffold_gs.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

template <class Config, class Visit>
void for_each_field(Config& c, Visit&& visit) {
  for_each_anchor_field(c, visit);
  visit("voxel_size", c.voxel_size);
  visit("update_depth", c.update_depth);
  visit("update_init_factor", c.update_init_factor);
  visit("update_hierarchy_factor", c.update_hierarchy_factor);
}

}  // namespace

nlohmann::json to_json(const ScaffoldConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

ScaffoldConfig scaffold_config_from_json(const nlohmann::json& json) {
  ScaffoldConfig config;
  fields_from_json(json, "backbone scaffold-gs", [&](auto&& visit) { for_each_field(config, visit); });
  const std::string what = "config of backbone scaffold-gs: ";
  check_anchor_config(config, what);
  require(config.voxel_size >= 0, what + "voxel_size must not be negative");
  require(config.update_depth >= 1 && config.update_depth <= 16, what + "update_depth must be 1 to 16");
  require(config.update_init_factor >= 1, what + "update_init_factor must be at least 1");
  require(config.update_hierarchy_factor >= 2, what + "update_hierarchy_factor must be at least 2");
  return config;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "photo_slam/photo_slam.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

template <class Config, class Visit>
void for_each_field(Config& config, Visit&& visit) {
  for_each_gaussian_field(config, visit);
  visit("position_steps", config.position_steps);
  visit("keyframe_uses", config.keyframe_uses);
  visit("loop_uses", config.loop_uses);
  visit("pyramid_levels", config.pyramid_levels);
  visit("level_uses", config.level_uses);
  visit("feature_cache", config.feature_cache);
  visit("protected_iterations", config.protected_iterations);
}

}  // namespace

PhotoSlamConfig::PhotoSlamConfig() {
  position_rate_initial = position_rate_final = 3.2e-4;
  gradient_threshold = 1e-3;
  min_opacity = 0.02;
  max_world_scale = 0;  // no pruning of large Gaussians
  densify_from = 0;
  opacity_reset_interval = kPublishedIterations;  // beyond densify_until: never
}

nlohmann::json to_json(const PhotoSlamConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

PhotoSlamConfig photo_slam_config_from_json(const nlohmann::json& json) {
  PhotoSlamConfig config;
  fields_from_json(json, "backbone photo-slam", [&](auto&& visit) { for_each_field(config, visit); });
  check_gaussian_config(config, "photo-slam");
  const std::string what = "config of backbone photo-slam: ";
  require(config.position_steps >= 1, what + "position_steps must be at least 1");
  require(config.keyframe_uses >= 1, what + "keyframe_uses must be at least 1");
  require(config.loop_uses >= 0, what + "loop_uses must be at least 0");
  require(config.pyramid_levels >= 0 && config.pyramid_levels <= 8, what + "pyramid_levels must be 0 to 8");
  require(config.level_uses >= 0, what + "level_uses must be at least 0");
  require(config.feature_cache >= 1, what + "feature_cache must be at least 1");
  require(config.protected_iterations >= 0, what + "protected_iterations must be at least 0");
  return config;
}

}  // namespace splatboost

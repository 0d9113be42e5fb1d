// SPDX-License-Identifier: Apache-2.0
#include "convex_splatting/convex_splatting.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

template <class Config, class Visit>
void for_each_field(Config& c, Visit&& visit) {
  visit("preset", c.preset);
  visit("absolute_distances", c.absolute_distances);
  visit("sh_degree", c.sh_degree);
  visit("points_rate_initial", c.points_rate_initial);
  visit("points_rate_final", c.points_rate_final);
  visit("feature_rate", c.feature_rate);
  visit("opacity_rate", c.opacity_rate);
  visit("smoothness_rate", c.smoothness_rate);
  visit("sharpness_rate", c.sharpness_rate);
  visit("mask_rate", c.mask_rate);
  visit("lambda_dssim", c.lambda_dssim);
  visit("lambda_mask", c.lambda_mask);
  visit("initial_size", c.initial_size);
  visit("initial_opacity", c.initial_opacity);
  visit("initial_smoothness", c.initial_smoothness);
  visit("initial_sharpness", c.initial_sharpness);
  visit("gradient_threshold", c.gradient_threshold);
  visit("large_scene", c.large_scene);
  visit("large_scene_factor", c.large_scene_factor);
  visit("child_size", c.child_size);
  visit("child_opacity", c.child_opacity);
  visit("child_log_sharpness", c.child_log_sharpness);
  visit("min_opacity", c.min_opacity);
  visit("min_mask", c.min_mask);
  visit("max_world_scale", c.max_world_scale);
  visit("reset_opacity", c.reset_opacity);
  visit("densify_from", c.densify_from);
  visit("densify_until", c.densify_until);
  visit("densify_interval", c.densify_interval);
  visit("opacity_reset_interval", c.opacity_reset_interval);
  visit("trim_interval", c.trim_interval);
  visit("sh_interval", c.sh_interval);
  visit("reference_focal", c.reference_focal);
  visit("released_view_direction", c.released_view_direction);
}

/// Defaults of a preset: the release's changes for outdoor scenes and for its light variant, relative to indoor scenes.
ConvexConfig preset_config(const std::string& preset) {
  ConvexConfig config;
  config.preset = preset;
  if (preset == "indoor") return config;
  config.points_rate_initial = 5e-4;
  config.points_rate_final = 5e-6;
  config.child_log_sharpness = 0.88;
  config.min_mask = 0.01;
  config.densify_until = 9000;
  if (preset == "outdoor") {
    config.gradient_threshold = 1e-6;
    config.initial_sharpness = 1e-3;
    config.sharpness_rate = 4e-3;
    config.child_size = 0.6;
  } else {
    config.gradient_threshold = 2.5e-5;
    config.initial_sharpness = 9.5e-4;
    config.child_size = 0.63;
    config.large_scene = 0;
  }
  return config;
}

void check(const ConvexConfig& config) {
  const std::string what = "config of backbone convex-splatting: ";
  require(config.sh_degree >= 0 && config.sh_degree <= 3, what + "sh_degree must be 0 to 3");
  require(config.points_rate_initial > 0 && config.points_rate_final > 0,
          what + "learning rates of points must be above 0");
  require(config.feature_rate >= 0 && config.opacity_rate >= 0 && config.smoothness_rate >= 0 &&
              config.sharpness_rate >= 0 && config.mask_rate >= 0,
          what + "learning rates must not be negative");
  require(config.min_opacity >= 0 && config.min_opacity < 1 && config.min_mask >= 0 && config.min_mask < 1,
          what + "min_opacity and min_mask must lie in [0, 1)");
  require(config.lambda_dssim >= 0 && config.lambda_dssim <= 1, what + "lambda_dssim must lie in [0, 1]");
  require(config.lambda_mask >= 0, what + "lambda_mask must not be negative");
  require(config.initial_size > 0 && config.initial_smoothness > 0 && config.initial_sharpness > 0,
          what + "initial_size, initial_smoothness and initial_sharpness must be above 0");
  require(config.initial_opacity > 0 && config.initial_opacity < 1, what + "initial_opacity must lie in (0, 1)");
  require(config.child_size > 0, what + "child_size must be above 0");
  require(config.child_opacity > 0 && config.child_opacity < 1, what + "child_opacity must lie in (0, 1)");
  require(config.reset_opacity > 0 && config.reset_opacity < 1, what + "reset_opacity must lie in (0, 1)");
  require(config.large_scene >= 0 && config.large_scene_factor > 0,
          what + "large_scene must not be negative, and large_scene_factor must be above 0");
  require(config.densify_interval > 0 && config.opacity_reset_interval > 0 && config.trim_interval > 0 &&
              config.sh_interval > 0,
          what + "intervals must be above 0");
  require(config.densify_interval <= 100'000'000, what + "densify_interval must be at most 100000000");
  require(config.densify_from >= 0 && config.densify_until >= 0,
          what + "densify_from and densify_until must not be negative");
  require(config.reference_focal >= 0 && config.reference_focal < 1e9,
          what + "reference_focal must be 0 or a focal length in pixels");
}

}  // namespace

nlohmann::json to_json(const ConvexConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

ConvexConfig convex_config_from_json(const nlohmann::json& json) {
  ConvexConfig config;
  const auto read = [&] {
    fields_from_json(json, "backbone convex-splatting", [&](auto&& visit) { for_each_field(config, visit); });
  };
  read();
  require(config.preset == "indoor" || config.preset == "outdoor" || config.preset == "light",
          "config of backbone convex-splatting: preset must be indoor, outdoor or light");
  config = preset_config(config.preset);
  read();
  check(config);
  return config;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "common/json_fields.h"
#include "vanilla/vanilla.h"

namespace splatboost {
namespace {

/// Calls visit(name, field) for every constant.
template <class Config, class Visit>
void for_each_field(Config& c, Visit&& visit) {
  visit("sh_degree", c.sh_degree);
  visit("position_rate_initial", c.position_rate_initial);
  visit("position_rate_final", c.position_rate_final);
  visit("feature_rate", c.feature_rate);
  visit("opacity_rate", c.opacity_rate);
  visit("scaling_rate", c.scaling_rate);
  visit("rotation_rate", c.rotation_rate);
  visit("lambda_dssim", c.lambda_dssim);
  visit("percent_dense", c.percent_dense);
  visit("gradient_threshold", c.gradient_threshold);
  visit("min_opacity", c.min_opacity);
  visit("max_world_scale", c.max_world_scale);
  visit("initial_opacity", c.initial_opacity);
  visit("reset_opacity", c.reset_opacity);
  visit("densify_from", c.densify_from);
  visit("densify_until", c.densify_until);
  visit("densify_interval", c.densify_interval);
  visit("opacity_reset_interval", c.opacity_reset_interval);
  visit("sh_interval", c.sh_interval);
}

}  // namespace

nlohmann::json to_json(const VanillaConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

VanillaConfig vanilla_config_from_json(const nlohmann::json& json) {
  VanillaConfig config;
  fields_from_json(json, "backbone vanilla", [&](auto&& visit) { for_each_field(config, visit); });
  const std::string what = "config of backbone vanilla: ";
  require(config.sh_degree >= 0 && config.sh_degree <= 3, what + "sh_degree must be 0 to 3");
  require(config.position_rate_initial > 0 && config.position_rate_final > 0, what + "position rates must be above 0");
  require(config.lambda_dssim >= 0 && config.lambda_dssim <= 1, what + "lambda_dssim must lie in [0, 1]");
  require(config.initial_opacity > 0 && config.initial_opacity < 1, what + "initial_opacity must lie in (0, 1)");
  require(config.reset_opacity > 0 && config.reset_opacity < 1, what + "reset_opacity must lie in (0, 1)");
  require(config.densify_interval > 0 && config.opacity_reset_interval > 0 && config.sh_interval > 0,
          what + "intervals must be above 0");
  require(config.densify_from >= 0 && config.densify_until >= 0,
          what + "densify_from and densify_until must not be negative");
  return config;
}

}  // namespace splatboost

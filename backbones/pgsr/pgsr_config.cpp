// SPDX-License-Identifier: Apache-2.0
#include <string>

#include "pgsr/pgsr.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

template <class Config, class Visit>
void for_each_field(Config& config, Visit&& visit) {
  for_each_gaussian_field(config, visit);
  visit("gradient_abs_threshold", config.gradient_abs_threshold);
  visit("split_radius", config.split_radius);
  visit("max_abs_splits", config.max_abs_splits);
  visit("max_gaussians", config.max_gaussians);
  visit("trim_interval", config.trim_interval);
  visit("trim_views", config.trim_views);
  visit("observe_transmittance", config.observe_transmittance);
  visit("flatness_weight", config.flatness_weight);
  visit("surface_from", config.surface_from);
  visit("normal_weight", config.normal_weight);
  visit("edge_aware", config.edge_aware);
  visit("geometric_weight", config.geometric_weight);
  visit("photometric_weight", config.photometric_weight);
  visit("max_pixel_noise", config.max_pixel_noise);
  visit("max_patches", config.max_patches);
  visit("ncc_scale", config.ncc_scale);
  visit("max_neighbors", config.max_neighbors);
  visit("neighbor_angle", config.neighbor_angle);
  visit("neighbor_nearest", config.neighbor_nearest);
  visit("neighbor_farthest", config.neighbor_farthest);
  visit("absolute_distances", config.absolute_distances);
  visit("virtual_cameras", config.virtual_cameras);
  visit("exposure", config.exposure);
  visit("exposure_from", config.exposure_from);
  visit("exposure_rate", config.exposure_rate);
}

}  // namespace

nlohmann::json to_json(const PgsrConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

PgsrConfig pgsr_config_from_json(const nlohmann::json& json) {
  PgsrConfig config;
  fields_from_json(json, "backbone pgsr", [&](auto&& visit) { for_each_field(config, visit); });
  check_gaussian_config(config, "pgsr");
  const std::string what = "config of backbone pgsr: ";
  const auto not_negative = [&](double value, const char* name) {
    require(value >= 0, what + name + " must be at least 0");
  };
  not_negative(config.gradient_abs_threshold, "gradient_abs_threshold");
  not_negative(config.split_radius, "split_radius");
  not_negative(config.max_abs_splits, "max_abs_splits");
  not_negative(config.max_gaussians, "max_gaussians");
  require(config.trim_interval > 0, what + "trim_interval must be above 0");
  not_negative(config.trim_views, "trim_views");
  require(config.observe_transmittance >= 0 && config.observe_transmittance < 1,
          what + "observe_transmittance must lie in [0, 1)");
  not_negative(config.flatness_weight, "flatness_weight");
  not_negative(config.surface_from, "surface_from");
  not_negative(config.normal_weight, "normal_weight");
  not_negative(config.geometric_weight, "geometric_weight");
  not_negative(config.photometric_weight, "photometric_weight");
  require(config.max_pixel_noise > 0, what + "max_pixel_noise must be above 0");
  not_negative(config.max_patches, "max_patches");
  require(config.ncc_scale >= 0.1 && config.ncc_scale <= 10, what + "ncc_scale must lie in [0.1, 10]");
  not_negative(config.max_neighbors, "max_neighbors");
  require(config.neighbor_angle > 0 && config.neighbor_angle <= 180, what + "neighbor_angle must lie in (0, 180]");
  require(config.neighbor_nearest >= 0 && config.neighbor_farthest > config.neighbor_nearest,
          what + "neighbor_farthest must be above neighbor_nearest, which must be at least 0");
  not_negative(config.exposure_from, "exposure_from");
  require(config.exposure_rate > 0, what + "exposure_rate must be above 0");
  return config;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Settings shared by all backbones of explicit Gaussians.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "splatboost/schedule.h"

namespace splatboost {

/// Defaults are those of 3DGS (Kerbl et al. 2023). Iterations are those of the published run; they scale with the
/// length of the run.
struct GaussianConfig {
  int sh_degree = 3;
  double position_rate_initial = 1.6e-4;  ///< × position_rate_scale
  double position_rate_final = 1.6e-6;    ///< × position_rate_scale, at position_rate_until
  double feature_rate = 2.5e-3;           ///< degree-0 spherical harmonics; higher degrees: / 20
  double opacity_rate = 0.05;
  double scaling_rate = 5e-3;
  double rotation_rate = 1e-3;
  double lambda_dssim = 0.2;
  double percent_dense = 0.01;       ///< × scene extent; up to this scale Gaussians clone, above it they split
  double gradient_threshold = 2e-4;  ///< for the mean norm of the screen gradient, NDC units
  double min_opacity = 0.005;
  /// × scene extent; larger ones are pruned after the first opacity reset, unless an adapter says otherwise; 0: never
  double max_world_scale = 0.1;
  double initial_opacity = 0.1;
  double reset_opacity = 0.01;
  int densify_from = 500;
  int densify_until = 15000;
  int densify_interval = 100;         ///< not scaled: the statistics need this many views
  int opacity_reset_interval = 3000;  ///< scaled, but at least 5 densify intervals
  int sh_interval = 1000;             ///< iterations per additional degree

  /// Length of the published run; given by the method, not a setting.
  int published_iterations = kPublishedIterations;
  // Also given by the method.
  double position_rate_scale = 0;  ///< 0: the scene extent
  int position_rate_until = 0;     ///< 0: the end of the run
};

/// Calls visit(name, field) for every setting.
template <class Config, class Visit>
void for_each_gaussian_field(Config& c, Visit&& visit) {
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

/// Throws InputError naming the backbone and the setting if a value is out of range.
void check_gaussian_config(const GaussianConfig& config, const std::string& backbone);

}  // namespace splatboost

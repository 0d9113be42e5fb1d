// SPDX-License-Identifier: Apache-2.0
/// @file 3D Gaussian Splatting as published (Kerbl et al. 2023), with hooks and no knowledge of acceleration.
#pragma once

#include <memory>

#include <nlohmann/json.hpp>

#include "common/backbone.h"

namespace splatboost {

/// The published constants. Iteration numbers are of the published run (30 000) and scale with the run's length.
struct VanillaConfig {
  int sh_degree = 3;
  double position_rate_initial = 1.6e-4;  ///< × scene extent
  double position_rate_final = 1.6e-6;    ///< × scene extent, at the end of the run
  double feature_rate = 2.5e-3;           ///< degree-0 spherical harmonics; higher degrees: / 20
  double opacity_rate = 0.05;
  double scaling_rate = 5e-3;
  double rotation_rate = 1e-3;
  double lambda_dssim = 0.2;
  double percent_dense = 0.01;       ///< × scene extent: largest scale that is cloned rather than split
  double gradient_threshold = 2e-4;  ///< of the mean screen gradient, NDC units
  double min_opacity = 0.005;
  double max_world_scale = 0.1;  ///< × scene extent; larger ones go after the first opacity reset
  double initial_opacity = 0.1;
  double reset_opacity = 0.01;
  int densify_from = 500;
  int densify_until = 15000;
  int densify_interval = 100;         ///< not scaled: statistics need that many views
  int opacity_reset_interval = 3000;  ///< in short runs not below 5 densify intervals
  int sh_interval = 1000;             ///< one degree more every so many iterations
};

nlohmann::json to_json(const VanillaConfig& config);
/// Reads the keys that are there over the defaults. Throws InputError on an unknown key or a wrong type.
VanillaConfig vanilla_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_vanilla(const BackboneContext& context, const VanillaConfig& config);

}  // namespace splatboost

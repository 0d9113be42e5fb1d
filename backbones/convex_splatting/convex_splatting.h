// SPDX-License-Identifier: Apache-2.0
/// @file 3D Convex Splatting (Held et al. 2024) as published, with hooks and no knowledge of acceleration.
#pragma once

#include <memory>
#include <string>

#include <nlohmann/json.hpp>

#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// The release's constants of indoor scenes; preset_config() has those of its other presets.
/// Iteration numbers are of a run of 30 000 and scale with the run's length.
struct ConvexConfig {
  std::string preset = "indoor";  ///< "outdoor", "light": other defaults of what follows
  int sh_degree = 3;
  double points_rate_initial = 4e-4;  ///< world units, not × scene extent
  double points_rate_final = 4e-6;    ///< at the end of the run
  double feature_rate = 2.5e-3;       ///< degree-0 spherical harmonics; higher degrees: / 20
  double opacity_rate = 0.01;
  double smoothness_rate = 5e-3;
  double sharpness_rate = 4.5e-3;
  double mask_rate = 0.01;
  double lambda_dssim = 0.2;
  double lambda_mask = 5e-4;  ///< × mean of the masks
  double initial_size = 1.2;  ///< radius × root of the mean squared distance to 3 neighbours
  double initial_opacity = 0.1;
  double initial_smoothness = 0.1;  ///< / root of the mean squared distance to 3 neighbours
  double initial_sharpness = 9e-4;
  double gradient_threshold = 6e-6;  ///< of the mean signed gradient of the sharpness; convexes at or above it split
  double large_scene = 300;          ///< extent of the points above which that is × large_scene_factor; 0: never
  double large_scene_factor = 8.5;
  double child_size = 0.7;            ///< of the parent's
  double child_opacity = 0.5;         ///< of the parent's
  double child_log_sharpness = 0.85;  ///< of the parent's logarithm
  double min_opacity = 0.03;
  double min_mask = 0.02;        ///< masks at or below it go
  double max_world_scale = 0.3;  ///< × scene extent; larger ones go after the first opacity reset
  double reset_opacity = 0.2;
  int densify_from = 500;
  int densify_until = 9500;
  int densify_interval = 200;         ///< not scaled: statistics need that many views
  int opacity_reset_interval = 3000;  ///< in short runs not below 5 densify intervals
  int trim_interval = 1000;           ///< after densify_until: faint and masked convexes go
  int sh_interval = 1000;             ///< one degree more every so many iterations
  /// Focal length, in pixels, of the images whose pixels smoothness and sharpness are of: about that of the paper's.
  /// 0: of the training images, whatever their size, as released. See docs/adding_a_backbone.md.
  double reference_focal = 1000;
  bool released_view_direction = false;  ///< the release's slip: spherical harmonics see x and y of a centre as its z
};

nlohmann::json to_json(const ConvexConfig& config);
/// Reads the keys that are there over the preset's defaults. Throws InputError on an unknown key or an impossible
/// value.
ConvexConfig convex_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_convex_splatting(const BackboneContext& context, const ConvexConfig& config);

}  // namespace splatboost

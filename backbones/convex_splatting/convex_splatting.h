// SPDX-License-Identifier: Apache-2.0
/// @file 3D Convex Splatting (Held et al. 2024) as published, with hooks but without any acceleration.
#pragma once

#include <memory>
#include <string>

#include <nlohmann/json.hpp>

#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// typical_depth() of a scene for which the published lengths are.
inline constexpr double kConvexDepth = 5;

/// Defaults are those of the release for indoor scenes; preset_config() has its other presets.
/// Iterations are for a run of 30 000 and scale with the length of the run.
struct ConvexConfig {
  std::string preset = "indoor";  ///< "outdoor", "light": other defaults for the fields below
  /// Whether lengths are in world units, as published. If not, they are for a scene seen from kConvexDepth, and are
  /// scaled by typical_depth(); and in runs shorter than the published one, points learn faster and convexes begin less
  /// sharp.
  bool absolute_distances = true;
  int sh_degree = 3;
  double points_rate_initial = 4e-4;  ///< not × scene extent
  double points_rate_final = 4e-6;    ///< at the end of the run
  double feature_rate = 2.5e-3;       ///< degree-0 spherical harmonics; higher degrees: / 20
  double opacity_rate = 0.01;
  double smoothness_rate = 5e-3;
  double sharpness_rate = 4.5e-3;
  double mask_rate = 0.01;
  double lambda_dssim = 0.2;
  double lambda_mask = 5e-4;  ///< × mean of the masks
  double initial_size = 1.2;  ///< radius, × root mean squared distance to 3 neighbours
  double initial_opacity = 0.1;
  double initial_smoothness = 0.1;   ///< / root mean squared distance to 3 neighbours
  double initial_sharpness = 9e-4;   ///< / a length
  double gradient_threshold = 6e-6;  ///< of the mean signed gradient of the sharpness; convexes at or above it split
  double large_scene = 300;          ///< the threshold is × large_scene_factor if the points extend further; 0: never
  double large_scene_factor = 8.5;
  double child_size = 0.7;            ///< × the parent's
  double child_opacity = 0.5;         ///< × the parent's, which may round to 1: below 1, for a finite logit
  double child_log_sharpness = 0.85;  ///< × the logarithm of the parent's
  double min_opacity = 0.03;
  double min_mask = 0.02;        ///< convexes with a mask at or below it are pruned
  double max_world_scale = 0.3;  ///< × scene extent; larger ones are pruned after the first opacity reset
  double reset_opacity = 0.2;
  int densify_from = 500;
  int densify_until = 9500;
  int densify_interval = 200;         ///< not scaled: the statistics need this many views
  int opacity_reset_interval = 3000;  ///< scaled, but at least 5 densify intervals
  int trim_interval = 1000;           ///< after densify_until: pruning of transparent and masked convexes
  int sh_interval = 1000;             ///< iterations per additional degree
  /// Focal length, px, of the reference image, in whose pixels smoothness and sharpness are measured: about that of the
  /// paper's images. 0: use the training images, whatever their size, as released. See docs/adding_a_backbone.md.
  double reference_focal = 1000;
  bool released_view_direction = false;  ///< as in ConvexOptions: reproduce a mistake of the release
};

nlohmann::json to_json(const ConvexConfig& config);
/// The defaults of the preset, overridden by the keys in `json`. Throws InputError on an unknown key or an invalid
/// value.
ConvexConfig convex_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_convex_splatting(const BackboneContext& context, const ConvexConfig& config);

}  // namespace splatboost

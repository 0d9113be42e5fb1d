// SPDX-License-Identifier: Apache-2.0
/// @file PGSR (Chen et al. 2024): flat Gaussians with consistent depth and normals within and between views.
#pragma once

#include <memory>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// Lengths in the release's settings are for scenes seen from about this distance.
inline constexpr double kPublishedDepth = 3;

/// The settings of 3DGS with the defaults of PGSR, and its own. Iterations scale with the length of the run.
struct PgsrConfig : GaussianConfig {
  PgsrConfig() { percent_dense = 0.001; }

  // Density control.
  double gradient_abs_threshold = 8e-4;  ///< large Gaussians also split from this absolute gradient on ...
  int split_radius = 20;                 ///< ... if a view observed them with a larger radius, px
  int max_abs_splits = 50000;            ///< per densification, for this reason
  int max_gaussians = 6000000;           ///< 0: unlimited
  /// Iterations between pruning of Gaussians that few views observe; scaled, at least the number of training views.
  int trim_interval = 1000;
  int trim_views = 2;                  ///< Gaussians observed by fewer views are pruned; 0: never
  double observe_transmittance = 0.5;  ///< minimum transmittance at which a pixel observes a Gaussian

  // Losses.
  double flatness_weight = 100;
  int surface_from = 7000;  ///< iteration after which the terms below apply
  double normal_weight = 0.015;
  bool edge_aware = true;  ///< lower weight of normals at edges of the photo
  double geometric_weight = 0.03;
  double photometric_weight = 0.15;
  double max_pixel_noise = 1;
  int max_patches = 102400;
  /// Patches are compared in photos of the training resolution divided by this: 0.5 for photos of twice the size.
  double ncc_scale = 1;

  // The second view.
  int max_neighbors = 8;
  double neighbor_angle = 30;  ///< degrees
  double neighbor_nearest = 0.01;
  double neighbor_farthest = 1.5;
  /// Whether these two, and the smallest depth compared, are in world units. If not, they are for a scene seen from
  /// kPublishedDepth, and are scaled by typical_depth().
  bool absolute_distances = false;
  /// Use a random camera near the first view, without a photo, for half of the second views, and for all second views
  /// if a view has no neighbour.
  bool virtual_cameras = false;

  // Exposure.
  bool exposure = false;  ///< compensate it by a gain and an offset per photo
  int exposure_from = 1000;
  double exposure_rate = 1e-3;
};

nlohmann::json to_json(const PgsrConfig& config);
/// The defaults, overridden by the keys in `json`. Throws InputError on an unknown key or a wrong type.
PgsrConfig pgsr_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_pgsr(const BackboneContext& context, const PgsrConfig& config);

}  // namespace splatboost

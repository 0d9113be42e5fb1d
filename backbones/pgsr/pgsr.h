// SPDX-License-Identifier: Apache-2.0
/// @file PGSR (Chen et al. 2024): Gaussians as planes, whose depth and normals agree within a view and between views.
#pragma once

#include <memory>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// The release's numbers of lengths are of scenes that cameras see from about this distance.
inline constexpr double kPublishedDepth = 3;

/// 3DGS's constants with those that PGSR changes, and its own. Iteration numbers scale with the run's length.
struct PgsrConfig : GaussianConfig {
  PgsrConfig() { percent_dense = 0.001; }

  // Density control.
  double gradient_abs_threshold = 8e-4;  ///< large Gaussians split from this absolute gradient on, too ...
  int split_radius = 20;                 ///< ... if one view observed them above so many pixels
  int max_abs_splits = 50000;            ///< at an event, for that reason
  int max_gaussians = 6000000;           ///< 0: as many as memory holds
  /// Gaussians that few views observe go; scaled, but not more often than the views are trained on once.
  int trim_interval = 1000;
  int trim_views = 2;                  ///< those of fewer go; 0: none goes
  double observe_transmittance = 0.5;  ///< a pixel observes what it sees through at least this

  // Losses.
  double flatness_weight = 100;
  int surface_from = 7000;  ///< the terms below begin after it
  double normal_weight = 0.015;
  bool edge_aware = true;  ///< normals count less where the photo has edges
  double geometric_weight = 0.03;
  double photometric_weight = 0.15;
  double max_pixel_noise = 1;
  int max_patches = 102400;

  // The second view.
  int max_neighbors = 8;
  double neighbor_angle = 30;  ///< degrees
  double neighbor_nearest = 0.01;
  double neighbor_farthest = 1.5;
  /// These two, and the nearest depth that is compared, are world units; otherwise they are of a scene whose cameras
  /// stand kPublishedDepth from what they see, and scale with the distance of these.
  bool absolute_distances = false;
  /// Half of the second views, and all where a view has no neighbour, are of a camera near the first that has no photo.
  bool virtual_cameras = false;

  // Exposure.
  bool exposure = false;  ///< compensated by a gain and an offset for each photo
  int exposure_from = 1000;
  double exposure_rate = 1e-3;
};

nlohmann::json to_json(const PgsrConfig& config);
/// Reads the keys that are there over the defaults. Throws InputError on an unknown key or a wrong type.
PgsrConfig pgsr_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_pgsr(const BackboneContext& context, const PgsrConfig& config);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file The mapper of Photo-SLAM (Huang et al. 2024): 3DGS with keyframes that arrive during training, Gaussians from
/// map points and features, image pyramids of the keyframes, and correction of the Gaussians when a loop is closed. For
/// a scene with all views present it is 3DGS with the settings of Photo-SLAM.
#pragma once

#include <memory>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// The settings of 3DGS with the defaults of Photo-SLAM, and:
struct PhotoSlamConfig : GaussianConfig {
  PhotoSlamConfig();
  int position_steps = 24;  ///< uses of a keyframe over which the position learning rate decays
  int keyframe_uses = 8;    ///< training iterations of a new keyframe
  int loop_uses = 2;        ///< additional ones per keyframe when a loop is closed
  int pyramid_levels = 2;   ///< initial downsampling of a keyframe: number of halvings
  int level_uses = 8;       ///< training iterations per level
  int feature_cache = 10;   ///< features are inserted as Gaussians once per this many keyframes
  /// With a density hook, no Gaussian is pruned for this many iterations after its insertion, and none at all for as
  /// long after a loop. By default one interval of growth: longer protection keeps many faint Gaussians while views
  /// arrive, which takes time from the mapper (docs/results/backbones.md). Not part of the published method.
  int protected_iterations = 100;
};

nlohmann::json to_json(const PhotoSlamConfig& config);
/// The defaults, overridden by the keys in `json`. Throws InputError on an unknown key or a wrong type.
PhotoSlamConfig photo_slam_config_from_json(const nlohmann::json& json);

/// The result also implements OnlineBackbone.
std::unique_ptr<Backbone> make_photo_slam(const BackboneContext& context, const PhotoSlamConfig& config);

}  // namespace splatboost

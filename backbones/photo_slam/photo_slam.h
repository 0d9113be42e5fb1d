// SPDX-License-Identifier: Apache-2.0
/// @file The mapper of Photo-SLAM (Huang et al. 2024): 3DGS of keyframes that come while it trains, with Gaussians from
/// map points and features, pyramids of the keyframes, and correction of the Gaussians at a loop. Of a scene whose
/// views are all there it is 3DGS with Photo-SLAM's constants.
#pragma once

#include <memory>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// 3DGS's constants, some with other values, and, beyond them:
struct PhotoSlamConfig : GaussianConfig {
  PhotoSlamConfig();
  int position_steps = 24;  ///< uses of a keyframe in which its rate of positions falls from initial to final
  int keyframe_uses = 8;    ///< trainings that a new keyframe is entitled to
  int loop_uses = 2;        ///< more of them for each keyframe when a loop is closed
  int pyramid_levels = 2;   ///< halvings of the images that a keyframe begins with
  int level_uses = 8;       ///< trainings of each of these levels
  int feature_cache = 10;   ///< features become Gaussians for so many keyframes at a time
  /// A hook removes none that was inserted fewer iterations ago, and none at all so soon after a loop. Ours.
  int protected_iterations = 200;
};

nlohmann::json to_json(const PhotoSlamConfig& config);
/// Reads the keys that are there over the defaults. Throws InputError on an unknown key or a wrong type.
PhotoSlamConfig photo_slam_config_from_json(const nlohmann::json& json);

/// It is an OnlineBackbone too.
std::unique_ptr<Backbone> make_photo_slam(const BackboneContext& context, const PhotoSlamConfig& config);

}  // namespace splatboost

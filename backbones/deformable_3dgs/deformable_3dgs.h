// SPDX-License-Identifier: Apache-2.0
/// @file Deformable-3DGS (Yang et al. 2024): 3DGS for dynamic scenes. An MLP deforms canonical Gaussians depending on
/// time.
#pragma once

#include <memory>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// The settings of 3DGS with the defaults of Deformable-3DGS, and its own.
struct DeformableConfig : GaussianConfig {
  DeformableConfig() {
    published_iterations = 40000;
    gradient_threshold = 7e-4;  // for absolute gradients
    position_rate_scale = 5;    // independent of the scene extent
    position_rate_until = 30000;
  }
  bool is_blender =
      false;             ///< with time net, fewer time frequencies, no time noise; program's default: Scene::synthetic
  bool is_6dof = false;  ///< means move by rigid motions, SE(3), instead of offsets
  int warm_up = 3000;    ///< iteration from which Gaussians are deformed
  double deform_rate_initial = 8e-4;
  double deform_rate_final = 1.6e-6;  ///< at the end of the run
  double time_noise = 0.1;            ///< initial standard deviation, × mean interval of times; unused if is_blender
  int time_noise_until = 20000;       ///< iteration at which the linear decay reaches 0
  int net_layers = 8;
  int net_width = 256;
};

nlohmann::json to_json(const DeformableConfig& config);
/// `defaults`, overridden by the keys in `json`. Throws InputError on an unknown key, a wrong type or an invalid
/// value.
DeformableConfig deformable_config_from_json(const nlohmann::json& json, const DeformableConfig& defaults = {});

/// Throws InputError unless the training views have at least two different times.
void require_times(const Scene& scene);

std::unique_ptr<Backbone> make_deformable(const BackboneContext& context, const DeformableConfig& config);

/// Mean interval between the distinct times of the views; 0 if there are fewer than two.
double mean_time_interval(const std::vector<View>& views);

/// Noise added to the time of a training view (paper, Sec. 3.4), which keeps the field smooth over time despite
/// inconsistent poses.
/// @param interval mean_time_interval() @param until iteration from which it is 0
double smoothing_noise(const DeformableConfig& config, double interval, int iteration, int until, std::uint64_t seed);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Deformable-3DGS (Yang et al. 2024): 3DGS for scenes that move. Gaussians are canonical, and a net says where
/// they are at a time.
#pragma once

#include <memory>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// 3DGS's constants with those that Deformable-3DGS changes, and its own.
struct DeformableConfig : GaussianConfig {
  DeformableConfig() {
    published_iterations = 40000;
    gradient_threshold = 7e-4;  // of absolute gradients
    position_rate_scale = 5;    // whatever the scene's size
    position_rate_until = 30000;
  }
  bool is_blender =
      false;             ///< a time net, coarser encoded times, and no noise; unless told: where pictures were computed
  bool is_6dof = false;  ///< means move by rigid motions, SE(3), in place of shifts
  int warm_up = 3000;    ///< from here on Gaussians move
  double deform_rate_initial = 8e-4;
  double deform_rate_final = 1.6e-6;  ///< at the end of the run
  double time_noise = 0.1;            ///< at the start, × the mean interval of times; real scenes only
  int time_noise_until = 20000;       ///< falls in a line to nothing
  int net_layers = 8;
  int net_width = 256;
};

nlohmann::json to_json(const DeformableConfig& config);
/// Reads the keys that are there over the defaults. Throws InputError on an unknown key, a wrong type or an impossible
/// value.
DeformableConfig deformable_config_from_json(const nlohmann::json& json, const DeformableConfig& defaults = {});

/// Throws InputError, in one line, unless the training views have times that differ.
void require_times(const Scene& scene);

std::unique_ptr<Backbone> make_deformable(const BackboneContext& context, const DeformableConfig& config);

/// Mean interval of the times that views were taken at; 0 where there is one.
double mean_time_interval(const std::vector<View>& views);

/// What is added to the time of a training view (paper, Sec. 3.4), so that the field stays smooth between times that
/// poses contradict each other at.
/// @param interval mean_time_interval() @param until iteration from which there is none
double smoothing_noise(const DeformableConfig& config, double interval, int iteration, int until, std::uint64_t seed);

}  // namespace splatboost

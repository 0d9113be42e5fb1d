// SPDX-License-Identifier: Apache-2.0
/// @file Mip-Splatting (Yu et al. 2024): 3DGS without aliasing, by a 3D smoothing filter and a 2D Mip filter. Density
/// control as its repository has it since April 2024, with the absolute gradients of Gaussian Opacity Fields.
#pragma once

#include <memory>
#include <span>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// 3DGS's constants and, beyond them:
struct MipSplattingConfig : GaussianConfig {
  double low_pass = 0.1;            ///< px², variance of the 2D Mip filter
  double smoothing_variance = 0.2;  ///< of the 3D filter, in (sampling interval)²
  double visibility_margin = 0.15;  ///< × image size, by which views see beyond their border for the 3D filter
  int smoothing_interval = 100;     ///< the 3D filter follows the Gaussians every so many iterations, not scaled
};

nlohmann::json to_json(const MipSplattingConfig& config);
/// Reads the keys that are there over the defaults. Throws InputError on an unknown key or a wrong type.
MipSplattingConfig mip_splatting_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_mip_splatting(const BackboneContext& context, const MipSplattingConfig& config);

/// The q-quantile of unordered values, interpolated linearly between neighbours; 0 of none.
float quantile(std::span<const float> values, double q);

}  // namespace splatboost

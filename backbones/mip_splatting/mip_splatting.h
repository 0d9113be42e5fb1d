// SPDX-License-Identifier: Apache-2.0
/// @file Mip-Splatting (Yu et al. 2024): alias-free 3DGS with a 3D smoothing filter and a 2D Mip filter. Density
/// control as in its repository since April 2024, with the absolute gradients of Gaussian Opacity Fields.
#pragma once

#include <memory>
#include <span>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// The settings of 3DGS, and:
struct MipSplattingConfig : GaussianConfig {
  double low_pass = 0.1;            ///< px², variance of the 2D Mip filter
  double smoothing_variance = 0.2;  ///< variance of the 3D filter, in (sampling interval)²
  double visibility_margin = 0.15;  ///< × image size; margin around views within which the 3D filter counts them
  int smoothing_interval = 100;     ///< iterations between updates of the 3D filter, not scaled
};

nlohmann::json to_json(const MipSplattingConfig& config);
/// The defaults, overridden by the keys in `json`. Throws InputError on an unknown key or a wrong type.
MipSplattingConfig mip_splatting_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_mip_splatting(const BackboneContext& context, const MipSplattingConfig& config);

/// The q-quantile of unordered values, with linear interpolation; 0 if empty.
float quantile(std::span<const float> values, double q);

}  // namespace splatboost

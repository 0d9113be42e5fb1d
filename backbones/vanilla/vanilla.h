// SPDX-License-Identifier: Apache-2.0
/// @file 3D Gaussian Splatting as published (Kerbl et al. 2023), with hooks but without any acceleration.
#pragma once

#include <memory>
#include <string>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

struct VanillaConfig : GaussianConfig {
  /// The release whose defaults are used. "2023": that of the paper. "2024": the main branch since then, which halves
  /// the learning rate of opacities and clamps images to 1 before the loss; later papers, including FastGS, report it.
  std::string release = "2023";
};

nlohmann::json to_json(const VanillaConfig& config);
/// The defaults, overridden by the keys in `json`. Throws InputError on an unknown key or a wrong type.
VanillaConfig vanilla_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_vanilla(const BackboneContext& context, const VanillaConfig& config);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file 3D Gaussian Splatting as published (Kerbl et al. 2023), with hooks and no knowledge of acceleration.
#pragma once

#include <memory>
#include <string>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

struct VanillaConfig : GaussianConfig {
  /// Of which release the constants are. "2023": the paper's own. "2024": its main branch since then, which halves the
  /// rate of opacities and cuts images at 1 before the loss; tables of later papers, FastGS's too, are of it.
  std::string release = "2023";
};

nlohmann::json to_json(const VanillaConfig& config);
/// Reads the keys that are there over the defaults. Throws InputError on an unknown key or a wrong type.
VanillaConfig vanilla_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_vanilla(const BackboneContext& context, const VanillaConfig& config);

}  // namespace splatboost

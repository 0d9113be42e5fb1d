// SPDX-License-Identifier: Apache-2.0
/// @file 3D Gaussian Splatting as published (Kerbl et al. 2023), with hooks and no knowledge of acceleration.
#pragma once

#include <memory>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

using VanillaConfig = GaussianConfig;

nlohmann::json to_json(const VanillaConfig& config);
/// Reads the keys that are there over the defaults. Throws InputError on an unknown key or a wrong type.
VanillaConfig vanilla_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_vanilla(const BackboneContext& context, const VanillaConfig& config);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file DropGaussian (Park et al. 2025): 3DGS for few views, regularised by dropping random Gaussians in each training
/// view.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_config.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// The settings of 3DGS with the defaults of DropGaussian, and its own.
struct DropGaussianConfig : GaussianConfig {
  DropGaussianConfig() {
    published_iterations = 10000;
    densify_until = 10000;  // to the end
    gradient_threshold = 5e-4;
    max_world_scale = 0;
  }
  double drop_rate = 0.2;  ///< share of Gaussians dropped at the end of the run; grows linearly from 0
};

nlohmann::json to_json(const DropGaussianConfig& config);
/// The defaults, overridden by the keys in `json`. Throws InputError on an unknown key or a wrong type.
DropGaussianConfig dropgaussian_config_from_json(const nlohmann::json& json);

std::unique_ptr<Backbone> make_dropgaussian(const BackboneContext& context, const DropGaussianConfig& config);

/// Computes the factors of opacities in one iteration (dropout.h).
/// @param factors [N]
void draw_dropout(std::uint64_t seed, int iteration, double rate, std::span<float> factors, Device device);

}  // namespace splatboost

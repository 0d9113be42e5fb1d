// SPDX-License-Identifier: Apache-2.0
/// @file Trainer of explicit Gaussians: parameters, activation, Adam, density control, model files, checkpoints.
#pragma once

#include <memory>

#include "families/gaussians/gaussian_config.h"
#include "families/gaussians/gaussian_method.h"
#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// Creates a backbone that trains Gaussians with `method`.
std::unique_ptr<Backbone> make_gaussian_backbone(const BackboneContext& context, const GaussianConfig& config,
                                                 std::unique_ptr<GaussianMethod> method);

}  // namespace splatboost

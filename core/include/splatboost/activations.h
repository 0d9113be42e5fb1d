// SPDX-License-Identifier: Apache-2.0
/// @file Activation functions: from trained parameters to the scales and opacities that are drawn.
#pragma once

#include <span>

#include "splatboost/device.h"

namespace splatboost {

/// to[i] = exp(from[i]), at most e^88: scales. Relative error below 3e-7.
void exponentials(std::span<const float> from, std::span<float> to, Device device);

/// to[i] = 1 / (1 + exp(-from[i])): opacities. Relative error below 1e-6.
void sigmoids(std::span<const float> from, std::span<float> to, Device device);

// Backward passes: turn gradients with respect to outputs into gradients with respect to inputs, in place.

/// gradients[i] *= exponentials[i]
void exponential_gradients(std::span<const float> exponentials, std::span<float> gradients, Device device);

/// gradients[i] *= sigmoids[i] · (1 − sigmoids[i])
void sigmoid_gradients(std::span<const float> sigmoids, std::span<float> gradients, Device device);

}  // namespace splatboost

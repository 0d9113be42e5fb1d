// SPDX-License-Identifier: Apache-2.0
/// @file One Adam step of one parameter group (Kingma and Ba 2015, bias-corrected, as in torch.optim.Adam).
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/device.h"

namespace splatboost {

struct AdamOptions {
  float learning_rate = 1e-3f;
  float beta1 = 0.9f;
  float beta2 = 0.999f;
  float epsilon = 1e-15f;  ///< 3DGS's value
};

/// values, gradients and moments have the same size and are owned by the caller. The step sets the gradients to zero,
/// so that they can accumulate again.
/// @param step number of this step, from 1
void adam_step(std::span<float> values, std::span<float> gradients, std::span<float> first_moments,
               std::span<float> second_moments, std::int64_t step, const AdamOptions& options, Device device);

}  // namespace splatboost

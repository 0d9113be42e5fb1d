// SPDX-License-Identifier: Apache-2.0
/// @file One Adam step of one parameter group (Kingma and Ba 2015, bias-corrected, as torch.optim.Adam does it).
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

/// values, gradients and moments are of one shape, owned by the caller. The gradients are consumed: they are zero
/// afterwards, ready to accumulate again.
/// @param step number of this step, from 1
void adam_step(std::span<float> values, std::span<float> gradients, std::span<float> first_moments,
               std::span<float> second_moments, std::int64_t step, const AdamOptions& options, Device device);

}  // namespace splatboost

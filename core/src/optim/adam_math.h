// SPDX-License-Identifier: Apache-2.0
/// @file Adam's update of one parameter.
#pragma once

#include <cmath>
#include <cstdint>

#include "device/host_device.h"
#include "splatboost/adam.h"

namespace splatboost {

/// Factors shared by all parameters of one step.
struct AdamFactors {
  float beta1, beta2;
  float step_size;          ///< learning rate / (1 − β1^t)
  float second_correction;  ///< 1 / √(1 − β2^t)
  float epsilon;
};

inline AdamFactors adam_factors(const AdamOptions& options, std::int64_t step) {
  const double t = static_cast<double>(step);
  return {options.beta1, options.beta2,
          static_cast<float>(static_cast<double>(options.learning_rate) /
                             (1.0 - std::pow(static_cast<double>(options.beta1), t))),
          static_cast<float>(1.0 / std::sqrt(1.0 - std::pow(static_cast<double>(options.beta2), t))), options.epsilon};
}

SPLATBOOST_HOST_DEVICE void adam_one(const AdamFactors& f, float gradient, float& value, float& first, float& second) {
  first = f.beta1 * first + (1.0f - f.beta1) * gradient;
  second = f.beta2 * second + (1.0f - f.beta2) * gradient * gradient;
  value -= f.step_size * first / (sqrtf(second) * f.second_correction + f.epsilon);
}

}  // namespace splatboost

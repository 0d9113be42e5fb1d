// SPDX-License-Identifier: Apache-2.0
/// @file Which Gaussians a training view goes without.
#pragma once

#include <span>

#include "splatboost/device.h"
#include "splatboost/random.h"

namespace splatboost {

/// What opacities are multiplied by: 0 with probability `rate`, else 1/(1 − rate), so that their expectation stays.
/// Element i takes the i-th number of the stream: the same on every device and for any number of threads.
/// @param rate in [0, 1)
/// @param factors [N]
void dropout_factors(const RandomStream& random, double rate, std::span<float> factors, Device device);

}  // namespace splatboost

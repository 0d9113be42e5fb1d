// SPDX-License-Identifier: Apache-2.0
/// @file Random dropout of Gaussians in a training view.
#pragma once

#include <span>

#include "splatboost/device.h"
#include "splatboost/random.h"

namespace splatboost {

/// Factors on opacities: 0 with probability `rate`, else 1/(1 − rate), which preserves their expectation.
/// Element i uses the i-th number of the stream: the same on every device and for any number of threads.
/// @param rate in [0, 1)
/// @param factors [N]
void dropout_factors(const RandomStream& random, double rate, std::span<float> factors, Device device);

}  // namespace splatboost

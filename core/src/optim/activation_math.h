// SPDX-License-Identifier: Apache-2.0
/// @file Derivatives of activations, as functions of their values.
#pragma once

#include "device/host_device.h"

namespace splatboost {

SPLATBOOST_HOST_DEVICE float sigmoid_slope(float sigmoid) { return sigmoid * (1.0f - sigmoid); }

}  // namespace splatboost

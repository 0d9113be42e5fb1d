// SPDX-License-Identifier: Apache-2.0
/// @file The formulas of convex_training.h for one convex.
#pragma once

#include "device/host_device.h"
#include "splatboost/convex_training.h"

namespace splatboost {

SPLATBOOST_HOST_DEVICE float masked_opacity(float opacity, float mask) {
  return mask > kConvexMaskThreshold ? opacity : 0.0f;
}

SPLATBOOST_HOST_DEVICE void add_masked_gradients(float opacity, float mask, float drawn, float mask_slope,
                                                 float& opacity_gradient, float& mask_gradient) {
  opacity_gradient += mask > kConvexMaskThreshold ? drawn : 0.0f;
  mask_gradient += drawn * opacity + mask_slope;
}

}  // namespace splatboost

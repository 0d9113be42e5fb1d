// SPDX-License-Identifier: Apache-2.0
/// @file Exposure of a photo as a gain and an offset of what is rendered (PGSR, Chen et al. 2024, Sec. 3.3).
#pragma once

#include <memory>
#include <span>

#include "splatboost/device.h"
#include "splatboost/photometric.h"

namespace splatboost {

/// exposed = exp(exposure[0]) · render + exposure[1]. Both may be the same memory.
/// @param exposure two numbers of the device
void expose(std::span<const float> render, std::span<const float> exposure, std::span<float> exposed, Device device);

/// weight · mean |exposed − truth| over valid pixels and channels.
/// Adds its gradients; sums on the CPU are of fixed order.
/// @param gradient [3,H,W] of the render
/// @param exposure_gradient two numbers
/// @param workspace of the device, four numbers; the first holds the loss afterwards
void add_exposed_l1(std::span<const float> render, const TruthImage& truth, std::span<const float> exposure,
                    float weight, std::span<float> gradient, std::span<float> exposure_gradient,
                    std::span<double> workspace, Device device);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Exposure of a photo, as a gain and an offset of the rendered image (PGSR, Chen et al. 2024, Sec. 3.3).
#pragma once

#include <memory>
#include <span>

#include "splatboost/device.h"
#include "splatboost/photometric.h"

namespace splatboost {

/// exposed = exp(exposure[0]) · render + exposure[1]. `render` and `exposed` may be the same memory.
/// @param exposure [2] in device memory
void expose(std::span<const float> render, std::span<const float> exposure, std::span<float> exposed, Device device);

/// Computes the loss weight · mean |exposed − truth| over valid pixels and channels, and adds its gradients. On the CPU
/// the order of summation is fixed.
/// @param gradient [3,H,W] with respect to the render
/// @param exposure_gradient [2]
/// @param workspace [4] in device memory; workspace[0] receives the loss
void add_exposed_l1(std::span<const float> render, const TruthImage& truth, std::span<const float> exposure,
                    float weight, std::span<float> gradient, std::span<float> exposure_gradient,
                    std::span<double> workspace, Device device);

}  // namespace splatboost

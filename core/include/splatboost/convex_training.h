// SPDX-License-Identifier: Apache-2.0
/// @file What training convexes needs besides drawing them: learned masks, and the statistic that they grow by.
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/device.h"

namespace splatboost {

/// Masks are sigmoids; a convex is drawn where its mask is above this, as if without a mask (Held et al. 2024, after
/// Lee et al. 2024).
inline constexpr float kConvexMaskThreshold = 0.01f;

/// drawn[i] = opacities[i] where masks[i] > kConvexMaskThreshold, else 0; all [N].
void mask_opacities(std::span<const float> opacities, std::span<const float> masks, std::span<float> drawn,
                    Device device);

/// Takes gradients of drawn opacities back, the threshold's by the straight-through rule: as if drawn = opacity · mask.
/// @param drawn [N] gradients; read only
/// @param mask_slope added to the gradient of every mask: of a loss that wants masks small
/// @param opacity_gradients,mask_gradients [N] added to; of the sigmoids
void mask_opacities_backward(std::span<const float> opacities, std::span<const float> masks,
                             std::span<const float> drawn, float mask_slope, std::span<float> opacity_gradients,
                             std::span<float> mask_gradients, Device device);

/// Sums over views since the last growth; all [N].
struct SharpnessSums {
  std::span<float> gradients;      ///< of ConvexGradients::view_sharpness
  std::span<float> gradients_abs;  ///< of view_sharpness_abs
  std::span<float> views;          ///< that saw the convex
};

/// Adds a view where the convex is visible.
/// @param gradients_abs empty: not gathered
void add_sharpness_gradients(std::span<const std::uint8_t> visible, std::span<const float> gradients,
                             std::span<const float> gradients_abs, const SharpnessSums& sums, Device device);

}  // namespace splatboost

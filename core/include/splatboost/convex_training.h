// SPDX-License-Identifier: Apache-2.0
/// @file Operations for training convexes besides rendering: learned masks, and the statistic that decides growth.
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/device.h"

namespace splatboost {

/// Masks are sigmoids. A convex with a mask above this is drawn with its full opacity; others are not drawn (Held et
/// al. 2024, after Lee et al. 2024).
inline constexpr float kConvexMaskThreshold = 0.01f;

/// drawn[i] = opacities[i] where masks[i] > kConvexMaskThreshold, else 0; all [N].
void mask_opacities(std::span<const float> opacities, std::span<const float> masks, std::span<float> drawn,
                    Device device);

/// Backward pass of mask_opacities(). Masks get a straight-through gradient, as if drawn = opacity · mask.
/// @param drawn [N] gradients with respect to drawn opacities
/// @param mask_slope added to the gradient of every mask: the slope of a loss that keeps masks small
/// @param opacity_gradients,mask_gradients [N] added to; with respect to the activated values
void mask_opacities_backward(std::span<const float> opacities, std::span<const float> masks,
                             std::span<const float> drawn, float mask_slope, std::span<float> opacity_gradients,
                             std::span<float> mask_gradients, Device device);

/// Sums over views since the last growth; all [N].
struct SharpnessSums {
  std::span<float> gradients;      ///< sum of ConvexGradients::view_sharpness
  std::span<float> gradients_abs;  ///< sum of view_sharpness_abs
  std::span<float> views;          ///< number of views where the convex was visible
};

/// Adds the gradients of one view to the sums of the convexes that are visible in it. All are [N].
/// @param gradients_abs may be empty: not gathered
void add_sharpness_gradients(std::span<const std::uint8_t> visible, std::span<const float> gradients,
                             std::span<const float> gradients_abs, const SharpnessSums& sums, Device device);

}  // namespace splatboost

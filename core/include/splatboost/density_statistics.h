// SPDX-License-Identifier: Apache-2.0
/// @file What density control wants to know of Gaussians, gathered from view to view.
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/device.h"

namespace splatboost {

/// How the two absolute gradients of a Gaussian, along x and y, become one number.
enum class AbsoluteNorm { euclidean, sum };

/// What a backward pass left of one view (rasterizer.h).
struct ScreenGradients {
  std::span<const std::uint8_t> visible;  ///< [N]
  std::span<const float> screen;          ///< [N,2] of means, px
  std::span<const float> screen_abs;      ///< [N,2] absolute; empty: not gathered
  int width = 0, height = 0;              ///< of the view, px
};

/// Sums over views. Spans are [N].
struct ScreenGradientSums {
  std::span<float> norms;      ///< of signed gradients, in NDC units
  std::span<float> norms_abs;  ///< of absolute ones
  std::span<float> views;      ///< that they come from
};

/// Adds one view for the Gaussians that are visible in it.
/// @param views how many it stands for
void add_screen_gradients(const ScreenGradients& view, AbsoluteNorm norm, float views, const ScreenGradientSums& sums,
                          Device device);

/// largest[i] = max(largest[i], radii[i]) where `observed` is not 0. All are [N].
/// @param radii on screen, px (Rasterizer::screen_radii())
/// @param observed pixels that observe a Gaussian (Rasterizer::count_observed())
void add_screen_radii(std::span<const std::int32_t> radii, std::span<const std::int32_t> observed,
                      std::span<std::int32_t> largest, Device device);

/// means[i] = norms[i] / max(views[i], 1), and likewise of the absolute ones.
void mean_screen_gradients(const ScreenGradientSums& sums, std::span<float> means, std::span<float> means_abs,
                           Device device);

/// @param scales [N,3]
/// @param longest [N]
void longest_scales(std::span<const float> scales, std::span<float> longest, Device device);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Statistics of Gaussians for density control, accumulated over views.
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/device.h"

namespace splatboost {

/// How the absolute gradients of a Gaussian along x and y are combined into one number.
enum class AbsoluteNorm { euclidean, sum };

/// Results of the backward pass of one view (rasterizer.h).
struct ScreenGradients {
  std::span<const std::uint8_t> visible;  ///< [N]
  std::span<const float> screen;          ///< [N,2] GaussianGradients::screen_means
  std::span<const float> screen_abs;      ///< [N,2] screen_means_abs; empty: not gathered
  int width = 0, height = 0;              ///< of the view, px
};

/// Sums over views. Spans are [N].
struct ScreenGradientSums {
  std::span<float> norms;      ///< norms of signed gradients, in NDC units
  std::span<float> norms_abs;  ///< norms of absolute gradients, in NDC units
  std::span<float> views;      ///< number of views
};

/// Adds one view to the sums of the Gaussians that are visible in it.
/// @param views number of views that it counts as
void add_screen_gradients(const ScreenGradients& view, AbsoluteNorm norm, float views, const ScreenGradientSums& sums,
                          Device device);

/// largest[i] = max(largest[i], radii[i]) where `observed` is not 0. All are [N].
/// @param radii screen radii, px (Rasterizer::screen_radii())
/// @param observed number of pixels that observe each Gaussian (Rasterizer::count_observed())
void add_screen_radii(std::span<const std::int32_t> radii, std::span<const std::int32_t> observed,
                      std::span<std::int32_t> largest, Device device);

/// means[i] = norms[i] / max(views[i], 1), and likewise for the absolute ones.
void mean_screen_gradients(const ScreenGradientSums& sums, std::span<float> means, std::span<float> means_abs,
                           Device device);

/// Largest of the three scales of each Gaussian.
/// @param scales [N,3]
/// @param longest [N]
void longest_scales(std::span<const float> scales, std::span<float> longest, Device device);

}  // namespace splatboost

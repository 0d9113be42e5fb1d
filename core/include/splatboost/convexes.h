// SPDX-License-Identifier: Apache-2.0
/// @file Smooth convexes, the primitives of 3D Convex Splatting (Held et al. 2024), as views of the caller's memory.
#pragma once

#include <cstddef>
#include <span>

#include "splatboost/gaussians.h"

namespace splatboost {

/// Fewest and most points of a convex.
inline constexpr int kMinConvexPoints = 3;
inline constexpr int kMaxConvexPoints = 8;

/// N convexes, row-major, owned by the caller. Shapes in brackets; an empty span means "not given".
///
/// A convex is drawn as the hull of its projected points, blurred. Let its centre, the mean of the points, be at depth
/// z, and L_k(q) = n_k·q + d_k the line of edge k of the hull in pixels, negative inside, with a normal as long as the
/// edge. Then at the pixel q
///
///   φ(q) = ln Σ_k exp(z·δ·L_k(q)),   I(q) = 1 / (1 + exp(z·σ·φ(q))),   α(q) = opacity · I(q),
///
/// and pixels are blended as in 3DGS, near to far by z.
struct Convexes {
  std::size_t count = 0;              ///< N
  int points_per_convex = 6;          ///< K, 3 to 8
  std::span<const float> points;      ///< [N,K,3] world
  std::span<const float> smoothness;  ///< [N] δ > 0: how closely φ follows the corners
  std::span<const float> sharpness;   ///< [N] σ > 0: how steeply I falls
  std::span<const float> opacities;   ///< [N], not drawn at 1/255 and below
  std::span<const float> sh_dc;       ///< [N,3] degree-0 spherical harmonics
  std::span<const float> sh_rest;     ///< [N,sh_rest_rows,3] higher degrees, in the field's order
  int sh_rest_rows = 0;               ///< coefficients stored a convex beyond the first (15 for degree 3)
  int sh_degree = 0;                  ///< active degree 0..3; (degree+1)² - 1 <= sh_rest_rows
  std::span<const float> colors;      ///< [N,3] instead of spherical harmonics, used as given
};

/// Throws ArgumentError with the field's name unless shapes fit and exactly one of spherical harmonics and colors is
/// given.
void check_convexes(const Convexes& convexes);

/// Gradients of the loss, shapes as in Convexes; spans that are empty are not written. Rows of convexes that the view
/// did not draw are set to zero (overwrite) or left alone (accumulate).
struct ConvexGradients {
  GradientMode mode = GradientMode::overwrite;
  std::span<float> points;
  std::span<float> smoothness;
  std::span<float> sharpness;
  std::span<float> opacities;
  std::span<float> sh_dc;
  std::span<float> sh_rest;
  std::span<float> colors;
  /// [N] gradient of the sharpness in this view alone, the method's statistic of growth; always overwritten, zero where
  /// not drawn.
  std::span<float> view_sharpness;
  /// [N] sum over pixels of that gradient's absolute value; always overwritten.
  std::span<float> view_sharpness_abs;
  /// [N,3] of the points' positions on screen, in pixels: Σ along x, Σ along y, and Σ of both absolute values, over the
  /// convex's points; always overwritten.
  std::span<float> screen_points;
};

}  // namespace splatboost

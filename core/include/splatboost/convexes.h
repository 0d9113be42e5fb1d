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
/// A convex is drawn as the smoothed convex hull of its projected points. Let z be the depth of its centre, the mean of
/// the points, and L_k(q) = n_k·q + d_k the line of hull edge k in pixels, negative inside, where ‖n_k‖ is the length
/// of the edge. Then at pixel q
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
  std::span<const float> opacities;   ///< [N], a convex of 1/255 or less is not drawn
  std::span<const float> sh_dc;       ///< [N,3] degree-0 spherical harmonics
  std::span<const float> sh_rest;     ///< [N,sh_rest_rows,3] higher degrees, in the order of 3DGS files
  int sh_rest_rows = 0;               ///< coefficients stored per convex beyond the first (15 for degree 3)
  int sh_degree = 0;                  ///< active degree 0..3; (degree+1)² - 1 <= sh_rest_rows
  std::span<const float> colors;      ///< [N,3] instead of spherical harmonics, used as given
};

/// Throws ArgumentError that names the field unless shapes match and exactly one of spherical harmonics and colors is
/// given.
void check_convexes(const Convexes& convexes);

/// Gradients of the loss, with shapes as in Convexes; empty spans are not written. Rows of convexes that the view
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
  /// [N] gradient of the sharpness in this view alone, the method's growth statistic; always overwritten, zero where
  /// not drawn.
  std::span<float> view_sharpness;
  /// [N] sum over pixels of that gradient's absolute value; always overwritten.
  std::span<float> view_sharpness_abs;
  /// [N,3] gradients with respect to the points' screen positions in pixels, summed over the convex's points: Σ ∂x,
  /// Σ ∂y, Σ (|∂x| + |∂y|); always overwritten.
  std::span<float> screen_points;
};

}  // namespace splatboost

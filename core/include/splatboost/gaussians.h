// SPDX-License-Identifier: Apache-2.0
/// @file What every backbone hands to the rasterizer: activated 3D Gaussians, as views of the caller's memory.
#pragma once

#include <cstddef>
#include <span>

namespace splatboost {

/// N Gaussians, row-major, owned by the caller. Shapes in brackets; an empty span means "not given".
struct Gaussians {
  std::size_t count = 0;               ///< N
  std::span<const float> means;        ///< [N,3] world
  std::span<const float> scales;       ///< [N,3] standard deviations along the own axes, world units, > 0
  std::span<const float> rotations;    ///< [N,4] quaternions (w,x,y,z), of any non-zero length: normalised here
  std::span<const float> covariances;  ///< [N,6] xx xy xz yy yz zz in world; instead of scales and rotations
  std::span<const float> opacities;    ///< [N], not drawn where below 0; above 1 only to make up for others (dropout)
  std::span<const float> sh_dc;        ///< [N,3] degree-0 spherical harmonics
  std::span<const float> sh_rest;      ///< [N,sh_rest_rows,3] higher degrees, in the field's order
  int sh_rest_rows = 0;                ///< coefficients stored a Gaussian beyond the first (15 for degree 3)
  int sh_degree = 0;                   ///< active degree 0..3; (degree+1)² - 1 <= sh_rest_rows
  std::span<const float> colors;       ///< [N,3] instead of spherical harmonics, used as given
  std::span<const float> features;     ///< [N,features_per_gaussian] extra channels to blend, 0..8 of them
  int features_per_gaussian = 0;
};

/// Throws ArgumentError with the field's name unless shapes fit, exactly one of scales+rotations and covariances
/// and exactly one of spherical harmonics and colors is given.
void check_gaussians(const Gaussians& gaussians);

/// How results of a backward pass meet what is in memory.
enum class GradientMode { overwrite, accumulate };

/// Gradients of the loss, shapes as in Gaussians; spans that are empty are not written. Rows of Gaussians that
/// the view did not draw are set to zero (overwrite) or left alone (accumulate).
struct GaussianGradients {
  GradientMode mode = GradientMode::overwrite;
  std::span<float> means;
  std::span<float> scales;
  std::span<float> rotations;
  std::span<float> covariances;
  std::span<float> opacities;
  std::span<float> sh_dc;
  std::span<float> sh_rest;
  std::span<float> colors;
  std::span<float> features;
  /// [N,2] gradient of the mean on screen, in pixels; always overwritten, zero where not drawn.
  std::span<float> screen_means;
  /// [N,2] sum over pixels of that gradient's absolute value, x and y apart (AbsGS); always overwritten.
  std::span<float> screen_means_abs;
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Activated 3D Gaussians, the input of the rasterizer, as views of the caller's memory.
#pragma once

#include <cstddef>
#include <span>

namespace splatboost {

/// N Gaussians, row-major, owned by the caller. Shapes in brackets; an empty span means "not given".
struct Gaussians {
  std::size_t count = 0;               ///< N
  std::span<const float> means;        ///< [N,3] world
  std::span<const float> scales;       ///< [N,3] standard deviations along its axes, world units, > 0
  std::span<const float> rotations;    ///< [N,4] quaternions (w,x,y,z), normalised by the library; not drawn if their
                                       ///< length is outside kMinQuaternionLength .. kMaxQuaternionLength
  std::span<const float> covariances;  ///< [N,6] xx xy xz yy yz zz, world; instead of scales and rotations
  std::span<const float> opacities;    ///< [N], not drawn unless finite and >= 0; may exceed 1 (for dropout)
  std::span<const float> sh_dc;        ///< [N,3] degree-0 spherical harmonics
  std::span<const float> sh_rest;      ///< [N,sh_rest_rows,3] higher degrees, in the order of 3DGS files
  int sh_rest_rows = 0;                ///< coefficients stored per Gaussian beyond the first (15 for degree 3)
  int sh_degree = 0;                   ///< active degree 0..3; (degree+1)² - 1 <= sh_rest_rows
  std::span<const float> colors;       ///< [N,3] instead of spherical harmonics, used as given
  std::span<const float> features;     ///< [N,features_per_gaussian] extra channels to blend, 0..8 of them
  int features_per_gaussian = 0;
};

/// Throws ArgumentError that names the field unless shapes match, exactly one of scales+rotations and covariances, and
/// exactly one of spherical harmonics and colors are given.
void check_gaussians(const Gaussians& gaussians);

/// Whether a backward pass overwrites the values in its outputs or adds to them.
enum class GradientMode { overwrite, accumulate };

/// Gradients of the loss, with shapes as in Gaussians; empty spans are not written. Rows of Gaussians that
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
  /// [N,6], on the CPU, instead of sh_rest: the factors of its gradient in this view (sh_factors.h); always
  /// overwritten, the gradient of the colour is zero where not drawn.
  std::span<float> sh_factors;
  /// [N,2] gradient with respect to the mean on screen, in pixels; always overwritten, zero where not drawn.
  std::span<float> screen_means;
  /// [N,2] sum over pixels of that gradient's absolute value, for x and y separately (AbsGS); always overwritten.
  std::span<float> screen_means_abs;
};

}  // namespace splatboost

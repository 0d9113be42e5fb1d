// SPDX-License-Identifier: Apache-2.0
/// @file The constants of the splatting model, each with its reason. They are defined here and nowhere else.
#pragma once

namespace splatboost {

/// Side of a square tile in pixels. With 16 a tile row fills one 512-bit register; 3DGS uses the same value.
inline constexpr int kTileSize = 16;

/// A splat contributes to a pixel where its alpha reaches one step of an 8-bit image: τ_α of paper eq. 15.
inline constexpr float kMinAlpha = 1.0f / 255.0f;

/// kMinAlpha as a base-2 logarithm: comparing exponents avoids most exponentials.
inline constexpr float kMinLog2Alpha = -7.994353436858858f;

/// 2·ln 2, converts from base-2 logarithms to Mahalanobis²: exp(-½·d²) = 2^(-d² / kTwoLn2).
inline constexpr float kTwoLn2 = 1.3862943611198906f;

/// Alpha is clamped to this, so that 1 / (1 - alpha) stays bounded in the backward pass.
inline constexpr float kMaxAlpha = 0.99f;

/// A pixel is saturated once the next splat would reduce its transmittance below this; that splat is not blended.
inline constexpr float kMinTransmittance = 1e-4f;

/// Variance in px² that is added to both axes of a projected covariance, about one pixel's footprint (3DGS).
inline constexpr float kLowPass = 0.3f;

/// Means nearer than this (world units along the view axis) are not drawn (3DGS).
inline constexpr float kNearPlane = 0.2f;

/// A Gaussian whose quaternion is shorter or longer than these is not drawn: the square of its length might underflow
/// or overflow, which distorts the rotation.
inline constexpr float kMinQuaternionLength = 1e-18f;
inline constexpr float kMaxQuaternionLength = 1e19f;

/// Half side of the 3DGS box in standard deviations of the longer axis.
inline constexpr float kBoxSigmas = 3.0f;

/// In the projection's Jacobian, x/z and y/z are clamped to this many times the half field of view around the image's
/// centre (3DGS): beyond it the affine approximation diverges.
inline constexpr float kFieldOfViewMargin = 1.3f;

/// Lower bound of the squared opacity compensation det(Σ)/det(Σ + low-pass), so that its square root is differentiable.
inline constexpr float kMinCompensation2 = 2.5e-5f;

/// Highest degree of spherical harmonics, and its number of coefficients per channel.
inline constexpr int kMaxShDegree = 3;
inline constexpr int kMaxShCoefficients = 16;

/// Number of coefficients per channel up to a degree.
constexpr int sh_coefficients(int degree) { return (degree + 1) * (degree + 1); }

/// The constant spherical harmonic (degree 0), 1 / (2·√π).
inline constexpr float kShConstant = 0.28209479177387814f;

/// Maximum number of extra feature channels that one pass can blend.
inline constexpr int kMaxFeatures = 8;

}  // namespace splatboost

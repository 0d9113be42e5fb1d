// SPDX-License-Identifier: Apache-2.0
/// @file Spherical harmonics for the reference implementations.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

namespace splatboost::reference {

inline constexpr double kPi = std::numbers::pi;

/// Real spherical harmonics up to degree 3 in closed form, in the order and with the signs of 3DGS (including the
/// Condon-Shortley phase: odd orders have a negative sign).
template <class Scalar>
std::array<Scalar, 16> sh_basis(const Scalar& x, const Scalar& y, const Scalar& z) {
  const Scalar xx = x * x;
  const Scalar yy = y * y;
  const Scalar zz = z * z;
  return {
      Scalar(0.5 * std::sqrt(1 / kPi)),
      -(0.5 * std::sqrt(3 / kPi)) * y,
      (0.5 * std::sqrt(3 / kPi)) * z,
      -(0.5 * std::sqrt(3 / kPi)) * x,
      (0.5 * std::sqrt(15 / kPi)) * (x * y),
      -(0.5 * std::sqrt(15 / kPi)) * (y * z),
      (0.25 * std::sqrt(5 / kPi)) * (2.0 * zz - xx - yy),
      -(0.5 * std::sqrt(15 / kPi)) * (x * z),
      (0.25 * std::sqrt(15 / kPi)) * (xx - yy),
      -(0.25 * std::sqrt(35 / (2 * kPi))) * (y * (3.0 * xx - yy)),
      (0.5 * std::sqrt(105 / kPi)) * (x * y * z),
      -(0.25 * std::sqrt(21 / (2 * kPi))) * (y * (4.0 * zz - xx - yy)),
      (0.25 * std::sqrt(7 / kPi)) * (z * (2.0 * zz - 3.0 * xx - 3.0 * yy)),
      -(0.25 * std::sqrt(21 / (2 * kPi))) * (x * (4.0 * zz - xx - yy)),
      (0.25 * std::sqrt(105 / kPi)) * (z * (xx - yy)),
      -(0.25 * std::sqrt(35 / (2 * kPi))) * (x * (xx - 3.0 * yy)),
  };
}

}  // namespace splatboost::reference

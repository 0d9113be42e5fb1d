// SPDX-License-Identifier: Apache-2.0
/// @file Real spherical harmonics to degree 3, in the order and signs that 3DGS files use.
#pragma once

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "host_device.h"
#include "splatboost/constants.h"

namespace splatboost {

/// Number of coefficients of a degree.
SPLATBOOST_HOST_DEVICE constexpr int sh_coefficients(int degree) { return (degree + 1) * (degree + 1); }

/// Normalisations of the real basis: degree 0 is 1/(2√π), degree 1 √(3/4π), and so on by the closed forms.
struct ShConstants {
  static constexpr float l0 = 0.28209479177387814f;
  static constexpr float l1 = 0.4886025119029199f;
  static constexpr float l2_xy = 1.0925484305920792f;   // ½√(15/π)
  static constexpr float l2_zz = 0.31539156525252005f;  // ¼√(5/π)
  static constexpr float l2_xx = 0.5462742152960396f;   // ¼√(15/π)
  static constexpr float l3_3 = 0.5900435899266435f;    // ¼√(35/2π)
  static constexpr float l3_2 = 2.890611442640554f;     // ½√(105/π)
  static constexpr float l3_1 = 0.4570457994644658f;    // ¼√(21/2π)
  static constexpr float l3_0 = 0.3731763325901154f;    // ¼√(7/π)
  static constexpr float l3_2d = 1.445305721320277f;    // ¼√(105/π)
};

/// Basis values at a unit direction. @param basis [sh_coefficients(degree)]
SPLATBOOST_HOST_DEVICE void sh_basis(int degree, glm::vec3 d, float* basis) {
  using C = ShConstants;
  const float x = d.x, y = d.y, z = d.z;
  basis[0] = C::l0;
  if (degree < 1) return;
  basis[1] = -C::l1 * y;
  basis[2] = C::l1 * z;
  basis[3] = -C::l1 * x;
  if (degree < 2) return;
  const float xx = x * x, yy = y * y, zz = z * z;
  basis[4] = C::l2_xy * x * y;
  basis[5] = -C::l2_xy * y * z;
  basis[6] = C::l2_zz * (2 * zz - xx - yy);
  basis[7] = -C::l2_xy * x * z;
  basis[8] = C::l2_xx * (xx - yy);
  if (degree < 3) return;
  basis[9] = -C::l3_3 * y * (3 * xx - yy);
  basis[10] = C::l3_2 * x * y * z;
  basis[11] = -C::l3_1 * y * (4 * zz - xx - yy);
  basis[12] = C::l3_0 * z * (2 * zz - 3 * xx - 3 * yy);
  basis[13] = -C::l3_1 * x * (4 * zz - xx - yy);
  basis[14] = C::l3_2d * z * (xx - yy);
  basis[15] = -C::l3_3 * x * (xx - 3 * yy);
}

/// Gradient of Σ_k weights[k]·basis[k](d) with respect to d, the three components taken as independent.
/// @param weights [sh_coefficients(degree)]
SPLATBOOST_HOST_DEVICE glm::vec3 sh_basis_gradient(int degree, glm::vec3 d, const float* w) {
  using C = ShConstants;
  glm::vec3 g(0.0f);
  if (degree < 1) return g;
  const float x = d.x, y = d.y, z = d.z;
  g += C::l1 * glm::vec3(-w[3], -w[1], w[2]);
  if (degree < 2) return g;
  g += C::l2_xy * (w[4] * glm::vec3(y, x, 0) - w[5] * glm::vec3(0, z, y) - w[7] * glm::vec3(z, 0, x));
  g += C::l2_zz * w[6] * glm::vec3(-2 * x, -2 * y, 4 * z);
  g += C::l2_xx * w[8] * glm::vec3(2 * x, -2 * y, 0);
  if (degree < 3) return g;
  const float xx = x * x, yy = y * y, zz = z * z;
  g -= C::l3_3 * w[9] * glm::vec3(6 * x * y, 3 * (xx - yy), 0);
  g += C::l3_2 * w[10] * glm::vec3(y * z, x * z, x * y);
  g -= C::l3_1 * w[11] * glm::vec3(-2 * x * y, 4 * zz - xx - 3 * yy, 8 * y * z);
  g += C::l3_0 * w[12] * glm::vec3(-6 * x * z, -6 * y * z, 6 * zz - 3 * xx - 3 * yy);
  g -= C::l3_1 * w[13] * glm::vec3(4 * zz - 3 * xx - yy, -2 * x * y, 8 * x * z);
  g += C::l3_2d * w[14] * glm::vec3(2 * x * z, -2 * y * z, xx - yy);
  g -= C::l3_3 * w[15] * glm::vec3(3 * (xx - yy), -6 * x * y, 0);
  return g;
}

/// Gradient with respect to v of a function of normalise(v), given the one with respect to the unit vector.
SPLATBOOST_HOST_DEVICE glm::vec3 through_normalise(glm::vec3 unit, float length, glm::vec3 gradient) {
  return (gradient - unit * glm::dot(unit, gradient)) / length;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Real spherical harmonics to degree 3, in the order and signs that 3DGS files use. T is a number type
/// (see host_device.h).

#if defined(SPLATBOOST_SH_MATH_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_SH_MATH_H_
#undef SPLATBOOST_SH_MATH_H_
#else
#define SPLATBOOST_SH_MATH_H_
#endif

#include "device/host_device.h"
#include "projection/vector_math.h"
#include "splatboost/constants.h"

SPLATBOOST_MATH_BEGIN

/// Normalisations of the real basis: degree 0 is 1/(2√π), degree 1 √(3/4π), and so on.
struct ShConstants {
  static constexpr float l0 = kShConstant;
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
template <class T>
SPLATBOOST_HOST_DEVICE void sh_basis(int degree, Vec3<T> d, T* basis) {
  using C = ShConstants;
  const T x = d.x, y = d.y, z = d.z;
  basis[0] = T(C::l0);
  if (degree < 1) return;
  basis[1] = T(-C::l1) * y;
  basis[2] = T(C::l1) * z;
  basis[3] = T(-C::l1) * x;
  if (degree < 2) return;
  const T two(2.0f), three(3.0f), four(4.0f);
  const T xx = x * x, yy = y * y, zz = z * z;
  basis[4] = T(C::l2_xy) * x * y;
  basis[5] = T(-C::l2_xy) * y * z;
  basis[6] = T(C::l2_zz) * (two * zz - xx - yy);
  basis[7] = T(-C::l2_xy) * x * z;
  basis[8] = T(C::l2_xx) * (xx - yy);
  if (degree < 3) return;
  basis[9] = T(-C::l3_3) * y * (three * xx - yy);
  basis[10] = T(C::l3_2) * x * y * z;
  basis[11] = T(-C::l3_1) * y * (four * zz - xx - yy);
  basis[12] = T(C::l3_0) * z * (two * zz - three * xx - three * yy);
  basis[13] = T(-C::l3_1) * x * (four * zz - xx - yy);
  basis[14] = T(C::l3_2d) * z * (xx - yy);
  basis[15] = T(-C::l3_3) * x * (xx - three * yy);
}

/// Gradient of Σ_k weights[k]·basis[k](d) with respect to d, whose three components are taken as independent.
/// @param w [sh_coefficients(degree)]
template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> sh_basis_gradient(int degree, Vec3<T> d, const T* w) {
  using C = ShConstants;
  const T zero(0.0f), two(2.0f), three(3.0f), four(4.0f), six(6.0f), eight(8.0f);
  Vec3<T> g{zero, zero, zero};
  if (degree < 1) return g;
  const T x = d.x, y = d.y, z = d.z;
  g = T(C::l1) * Vec3<T>{-w[3], -w[1], w[2]};
  if (degree < 2) return g;
  g = g + T(C::l2_xy) * Vec3<T>{w[4] * y - w[7] * z, w[4] * x - w[5] * z, -(w[5] * y + w[7] * x)};
  g = g + (T(2 * C::l2_zz) * w[6]) * Vec3<T>{-x, -y, two * z};
  g = g + (T(2 * C::l2_xx) * w[8]) * Vec3<T>{x, -y, zero};
  if (degree < 3) return g;
  const T xx = x * x, yy = y * y, zz = z * z;
  const T xy = x * y, xz = x * z, yz = y * z;
  g = g - (T(3 * C::l3_3) * w[9]) * Vec3<T>{two * xy, xx - yy, zero};
  g = g + (T(C::l3_2) * w[10]) * Vec3<T>{yz, xz, xy};
  g = g - (T(C::l3_1) * w[11]) * Vec3<T>{-(two * xy), four * zz - xx - three * yy, eight * yz};
  g = g + (T(C::l3_0) * w[12]) * Vec3<T>{-(six * xz), -(six * yz), six * zz - three * xx - three * yy};
  g = g - (T(C::l3_1) * w[13]) * Vec3<T>{four * zz - three * xx - yy, -(two * xy), eight * xz};
  g = g + (T(C::l3_2d) * w[14]) * Vec3<T>{two * xz, -(two * yz), xx - yy};
  g = g - (T(3 * C::l3_3) * w[15]) * Vec3<T>{xx - yy, -(two * xy), zero};
  return g;
}

/// Gradient with respect to v of a function of normalise(v), given that with respect to the unit vector.
template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> through_normalise(Vec3<T> unit, T inverse_length, Vec3<T> gradient) {
  return inverse_length * (gradient - dot(unit, gradient) * unit);
}

SPLATBOOST_MATH_END

#endif  // guard

// SPDX-License-Identifier: Apache-2.0
/// @file Small vectors and matrices over a number type (see host_device.h).

#if defined(SPLATBOOST_VECTOR_MATH_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_VECTOR_MATH_H_
#undef SPLATBOOST_VECTOR_MATH_H_
#else
#define SPLATBOOST_VECTOR_MATH_H_
#endif

#include "device/host_device.h"

SPLATBOOST_MATH_BEGIN

template <class T>
struct Vec2 {
  T x, y;
};

template <class T>
struct Vec3 {
  T x, y, z;
};

template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> operator+(Vec3<T> a, Vec3<T> b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> operator-(Vec3<T> a, Vec3<T> b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> operator*(T s, Vec3<T> a) {
  return {s * a.x, s * a.y, s * a.z};
}
template <class T>
SPLATBOOST_HOST_DEVICE T dot(Vec3<T> a, Vec3<T> b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

/// Quaternion.
template <class T>
struct Quaternion {
  T w, x, y, z;
};

template <class T>
SPLATBOOST_HOST_DEVICE T dot(Quaternion<T> a, Quaternion<T> b) {
  return a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
SPLATBOOST_HOST_DEVICE Quaternion<T> operator*(T s, Quaternion<T> a) {
  return {s * a.w, s * a.x, s * a.y, s * a.z};
}

/// 3×3 matrix, by columns.
template <class T>
struct Matrix3 {
  Vec3<T> x, y, z;
};

/// Symmetric 3×3 matrix.
template <class T>
struct Symmetric3 {
  T xx, xy, xz, yy, yz, zz;
};

template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> operator*(const Symmetric3<T>& m, Vec3<T> v) {
  return {m.xx * v.x + m.xy * v.y + m.xz * v.z, m.xy * v.x + m.yy * v.y + m.yz * v.z,
          m.xz * v.x + m.yz * v.y + m.zz * v.z};
}

/// Symmetric 2×2 matrix.
template <class T>
struct Symmetric2 {
  T xx, xy, yy;
};

SPLATBOOST_MATH_END

#endif  // guard

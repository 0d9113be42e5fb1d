// SPDX-License-Identifier: Apache-2.0
/// @file The plane of a Gaussian and its gradients (PGSR, Chen et al. 2024, Sec. 3.1). T is any type of number (see
/// host_device.h): float on a GPU, a vector of Gaussians on a CPU.

#if defined(SPLATBOOST_PLANE_MATH_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_PLANE_MATH_H_
#undef SPLATBOOST_PLANE_MATH_H_
#else
#define SPLATBOOST_PLANE_MATH_H_
#endif

#include "device/host_device.h"
#include "projection/project_math.h"

SPLATBOOST_MATH_BEGIN

template <class T>
struct GaussianPlane {
  Vec3<T> normal;  ///< in the camera frame, towards the camera
  T distance;
};

/// Values shared by the forward and the backward pass.
template <class T>
struct PlaneOf {
  Quaternion<T> unit;
  T inverse_length;  ///< of the quaternion as stored
  T axis[3];         ///< ±1 at the shortest axis, negative if that axis points away from the camera, and 0 elsewhere
  Vec3<T> normal;    ///< in the world
  Vec3<T> toward;    ///< from the mean to the camera
};

/// A direction of the world in the camera frame, and back.
template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> turned(const ProjectionCamera& camera, Vec3<T> v) {
  return {dot(widen<T>(camera.axis_x), v), dot(widen<T>(camera.axis_y), v), dot(widen<T>(camera.axis_z), v)};
}
template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> turned_back(const ProjectionCamera& camera, Vec3<T> v) {
  return v.x * widen<T>(camera.axis_x) + v.y * widen<T>(camera.axis_y) + v.z * widen<T>(camera.axis_z);
}

template <class Condition, class T>
SPLATBOOST_HOST_DEVICE Vec3<T> select(Condition condition, Vec3<T> a, Vec3<T> b) {
  return {select(condition, a.x, b.x), select(condition, a.y, b.y), select(condition, a.z, b.z)};
}

/// @param scales of equal ones the first counts as the shortest
template <class T>
SPLATBOOST_HOST_DEVICE PlaneOf<T> plane_of(Vec3<T> mean, const T (&scales)[3], Quaternion<T> rotation,
                                           const ProjectionCamera& camera) {
  const T zero(0.0f), one(1.0f);
  PlaneOf<T> of;
  of.inverse_length = one / sqrt_of(dot(rotation, rotation));
  of.unit = of.inverse_length * rotation;
  const auto second = scales[1] < scales[0];
  const auto third = scales[2] < select(second, scales[1], scales[0]);
  const Matrix3<T> axes = rotation_of(of.unit);
  const Vec3<T> column = select(third, axes.z, select(second, axes.y, axes.x));
  // Computed in the camera frame: far from the origin of the world, camera centre − mean would lose digits.
  const Vec3<T> at = turned(camera, mean) + widen<T>(camera.translation);
  of.toward = -one * turned_back(camera, at);
  const T side = select(dot(column, of.toward) < zero, -one, one);
  of.normal = side * column;
  of.axis[0] = select(third, zero, select(second, zero, side));
  of.axis[1] = select(third, zero, select(second, side, zero));
  of.axis[2] = select(third, side, zero);
  return of;
}

template <class T>
SPLATBOOST_HOST_DEVICE GaussianPlane<T> in_camera(const PlaneOf<T>& of, const ProjectionCamera& camera) {
  return {turned(camera, of.normal), dot(of.normal, of.toward)};
}

/// Gradients of the mean and of the quaternion as stored.
/// @param g with respect to in_camera()
template <class T>
SPLATBOOST_HOST_DEVICE void plane_gradients(const PlaneOf<T>& of, const ProjectionCamera& camera,
                                            const GaussianPlane<T>& g, Vec3<T>& g_mean, Quaternion<T>& g_rotation) {
  g_mean = -g.distance * of.normal;
  const Vec3<T> g_normal = turned_back(camera, g.normal) + g.distance * of.toward;
  const Quaternion<T> g_unit =
      rotation_gradient(of.unit, Matrix3<T>{of.axis[0] * g_normal, of.axis[1] * g_normal, of.axis[2] * g_normal});
  const T along = dot(g_unit, of.unit);
  g_rotation = {(g_unit.w - of.unit.w * along) * of.inverse_length, (g_unit.x - of.unit.x * along) * of.inverse_length,
                (g_unit.y - of.unit.y * along) * of.inverse_length, (g_unit.z - of.unit.z * along) * of.inverse_length};
}

SPLATBOOST_MATH_END

#endif  // per-target include guard

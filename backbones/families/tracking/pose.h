// SPDX-License-Identifier: Apache-2.0
/// @file Rigid motions and pinhole intrinsics of a tracked camera, in double precision.
#pragma once

#include <Eigen/Geometry>

namespace splatboost::tracking {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;

/// p → rotation · p + translation; for a camera: camera_from_world.
struct Pose {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Vec3 translation = Vec3::Zero();

  Vec3 operator*(const Vec3& p) const { return rotation * p + translation; }
  Pose operator*(const Pose& first) const {
    return {(rotation * first.rotation).normalized(), rotation * first.translation + translation};
  }
  Pose inverse() const {
    const Eigen::Quaterniond back = rotation.conjugate();
    return {back, -(back * translation)};
  }
  /// Camera centre in world space.
  Vec3 centre() const { return -(rotation.conjugate() * translation); }
};

/// Angle between the rotations of two poses, radians.
inline double angle_between(const Pose& a, const Pose& b) { return a.rotation.angularDistance(b.rotation); }

/// Pinhole intrinsics without distortion; the centre of pixel (i, j) is at (i, j).
struct Optics {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;

  /// Projects a point in front of the camera, in camera space.
  Vec2 project(const Vec3& p) const { return {fx * p.x() / p.z() + cx, fy * p.y() / p.z() + cy}; }
  Vec3 unproject(const Vec2& pixel, double depth) const {
    return {(pixel.x() - cx) / fx * depth, (pixel.y() - cy) / fy * depth, depth};
  }
  bool contains(const Vec2& pixel) const {
    return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() <= width - 1 && pixel.y() <= height - 1;
  }
};

}  // namespace splatboost::tracking

// SPDX-License-Identifier: Apache-2.0
/// @file Rigid motions and the pinhole of a tracked camera, in double.
#pragma once

#include <Eigen/Geometry>

namespace splatboost::tracking {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;

/// p → rotation · p + translation; of a camera: camera_from_world.
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
  /// Of a camera, in the world.
  Vec3 centre() const { return -(rotation.conjugate() * translation); }
};

/// Angle between the two, radians.
inline double angle_between(const Pose& a, const Pose& b) { return a.rotation.angularDistance(b.rotation); }

/// Without distortion; the middle of pixel (i, j) is at (i, j).
struct Optics {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;

  /// Of a point in front of the camera.
  Vec2 project(const Vec3& p) const { return {fx * p.x() / p.z() + cx, fy * p.y() / p.z() + cy}; }
  Vec3 unproject(const Vec2& pixel, double depth) const {
    return {(pixel.x() - cx) / fx * depth, (pixel.y() - cy) / fy * depth, depth};
  }
  bool contains(const Vec2& pixel) const {
    return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() <= width - 1 && pixel.y() <= height - 1;
  }
};

}  // namespace splatboost::tracking

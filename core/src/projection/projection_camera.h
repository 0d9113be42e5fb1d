// SPDX-License-Identifier: Apache-2.0
/// @file A camera in the form that projection reads.
#pragma once

#include <algorithm>

#include "splatboost/camera.h"
#include "splatboost/constants.h"

namespace splatboost {

struct ProjectionCamera {
  float axis_x[3], axis_y[3], axis_z[3];  ///< axes of the camera in world coordinates
  float translation[3];                   ///< origin of the world in the camera frame
  float centre[3];                        ///< of projection, in world coordinates
  float fx, fy, cx, cy;
  /// Range to which x/z and y/z are clamped in the Jacobian: the image with a margin, and the optical axis.
  float low_x, high_x, low_y, high_y;
};

inline ProjectionCamera make_projection_camera(const Camera& camera) {
  ProjectionCamera p{};
  const glm::mat3 rotation = camera.rotation();
  const glm::vec3 centre = camera.centre();
  for (int k = 0; k < 3; ++k) {
    p.axis_x[k] = rotation[k][0];
    p.axis_y[k] = rotation[k][1];
    p.axis_z[k] = rotation[k][2];
    p.translation[k] = camera.camera_from_world[3][k];
    p.centre[k] = centre[k];
  }
  p.fx = camera.fx;
  p.fy = camera.fy;
  p.cx = camera.cx;
  p.cy = camera.cy;
  const auto width = static_cast<float>(camera.width), height = static_cast<float>(camera.height);
  const float limit_x = kFieldOfViewMargin * 0.5f * width / camera.fx,
              limit_y = kFieldOfViewMargin * 0.5f * height / camera.fy;
  // x/z at the image's centre, which is 0 if the principal point is there.
  const float middle_x = (0.5f * width - camera.cx) / camera.fx, middle_y = (0.5f * height - camera.cy) / camera.fy;
  // The optical axis, which may be far outside of the image, is always in the range: clamping only reduces |x/z|.
  p.low_x = std::min(middle_x - limit_x, 0.0f);
  p.high_x = std::max(middle_x + limit_x, 0.0f);
  p.low_y = std::min(middle_y - limit_y, 0.0f);
  p.high_y = std::max(middle_y + limit_y, 0.0f);
  return p;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file A camera in the form that projection reads.
#pragma once

#include "splatboost/camera.h"
#include "splatboost/constants.h"

namespace splatboost {

struct ProjectionCamera {
  float axis_x[3], axis_y[3], axis_z[3];  ///< axes of the camera in world coordinates
  float translation[3];                   ///< origin of the world in the camera frame
  float centre[3];                        ///< of projection, in world coordinates
  float fx, fy, cx, cy;
  float limit_x, limit_y;  ///< clamp of x/z and y/z in the Jacobian
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
  p.limit_x = kFieldOfViewMargin * 0.5f * static_cast<float>(camera.width) / camera.fx;
  p.limit_y = kFieldOfViewMargin * 0.5f * static_cast<float>(camera.height) / camera.fy;
  return p;
}

}  // namespace splatboost

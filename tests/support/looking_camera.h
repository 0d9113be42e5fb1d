// SPDX-License-Identifier: Apache-2.0
/// @file Cameras for tests.
#pragma once

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#include "splatboost/camera.h"

namespace splatboost::testing {

/// A camera at `eye` that looks at the origin, y down.
inline Camera camera_looking_at_origin(glm::vec3 eye, int width, int height) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = 0.9f * static_cast<float>(width);
  camera.cx = 0.5f * static_cast<float>(width);
  camera.cy = 0.5f * static_cast<float>(height);
  const glm::vec3 forward = glm::normalize(-eye);
  const glm::vec3 right = glm::normalize(glm::cross(forward, glm::vec3(0, 1, 0)));
  const glm::vec3 down = glm::cross(forward, right);
  for (int c = 0; c < 3; ++c) {
    camera.camera_from_world[c][0] = right[c];
    camera.camera_from_world[c][1] = down[c];
    camera.camera_from_world[c][2] = forward[c];
  }
  camera.camera_from_world[3] = glm::vec4(-glm::dot(right, eye), -glm::dot(down, eye), -glm::dot(forward, eye), 1.0f);
  return camera;
}

}  // namespace splatboost::testing

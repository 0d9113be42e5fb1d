// SPDX-License-Identifier: Apache-2.0
/// @file Cameras for tests.
#pragma once

#include <cmath>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#include "splatboost/camera.h"

namespace splatboost::testing {

/// A camera of 100 x 80 pixels and focal lengths of 100 at `centre` that looks along +z, turned by an angle about y.
inline Camera camera_along_z(const glm::vec3& centre, double degrees = 0) {
  const double angle = degrees * 3.14159265358979 / 180;
  Camera camera;
  camera.width = 100;
  camera.height = 80;
  camera.fx = camera.fy = 100;
  camera.cx = 50;
  camera.cy = 40;
  glm::mat4& pose = camera.camera_from_world;
  pose[0] = glm::vec4(std::cos(angle), 0, std::sin(angle), 0);
  pose[1] = glm::vec4(0, 1, 0, 0);
  pose[2] = glm::vec4(-std::sin(angle), 0, std::cos(angle), 0);
  pose[3] = glm::vec4(-(glm::mat3(pose) * centre), 1);
  return camera;
}

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

// SPDX-License-Identifier: Apache-2.0
/// @file A pinhole camera.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>

namespace splatboost {

// The library passes vectors and matrices of GLM: GLM_FORCE_DEFAULT_ALIGNED_GENTYPES, for instance, would give a caller
// another layout of every struct that has one.
static_assert(sizeof(glm::vec3) == 12 && alignof(glm::vec3) == 4 && sizeof(glm::mat4) == 64 && alignof(glm::mat4) == 4,
              "SplatBoost needs GLM's default, packed types: remove the GLM_FORCE_… definition that aligns them");

/// Pinhole camera in COLMAP's frame: x right, y down, z forward. Pixel (column i, row j) has its centre at
/// (i + 0.5, j + 0.5); a point (x, y, z) in the camera frame projects to (fx·x/z + cx, fy·y/z + cy).
struct Camera {
  int width = 0;   ///< pixels
  int height = 0;  ///< pixels
  float fx = 0;    ///< focal lengths and principal point in pixels
  float fy = 0;
  float cx = 0;
  float cy = 0;
  glm::mat4 camera_from_world{1.0f};  ///< rigid, column-major (glm); points are column vectors

  glm::mat3 rotation() const { return glm::mat3(camera_from_world); }
  /// Centre of projection in world coordinates.
  glm::vec3 centre() const;
  int tiles_x() const;
  int tiles_y() const;
};

/// Throws ArgumentError unless sizes and focal lengths are positive, all entries are finite, and the pose is rigid,
/// to within 1e-2 in the products of the axes.
void check_camera(const Camera& camera);

}  // namespace splatboost

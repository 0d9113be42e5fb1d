// SPDX-License-Identifier: Apache-2.0
#include "splatboost/camera.h"

#include <cmath>

#include <glm/matrix.hpp>

#include "splatboost/constants.h"
#include "splatboost/errors.h"

namespace splatboost {

glm::vec3 Camera::centre() const {
  const glm::vec3 translation(camera_from_world[3]);
  return -(glm::transpose(rotation()) * translation);
}

namespace {

/// Without overflow for any length.
int tiles_along(int length) { return length / kTileSize + (length % kTileSize != 0 ? 1 : 0); }

/// Poses read from text, or rounded by the caller, may have errors of this size.
constexpr float kRigidTolerance = 1e-2f;

bool is_rigid(const glm::mat4& pose) {
  const glm::mat3 rotation(pose);
  const glm::mat3 product = glm::transpose(rotation) * rotation;
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) {
      if (!(std::abs(product[column][row] - (row == column ? 1.0f : 0.0f)) < kRigidTolerance)) return false;
    }
    if (!(std::abs(pose[column][3]) < kRigidTolerance)) return false;
  }
  return std::abs(pose[3][3] - 1.0f) < kRigidTolerance && glm::determinant(rotation) > 0;
}

}  // namespace

int Camera::tiles_x() const { return tiles_along(width); }
int Camera::tiles_y() const { return tiles_along(height); }

void check_camera(const Camera& camera) {
  SPLATBOOST_CHECK(camera.width > 0 && camera.height > 0, "a camera needs a positive width and height");
  SPLATBOOST_CHECK(camera.fx > 0 && camera.fy > 0 && std::isfinite(camera.fx) && std::isfinite(camera.fy),
                   "a camera needs finite focal lengths above zero");
  SPLATBOOST_CHECK(std::isfinite(camera.cx) && std::isfinite(camera.cy), "a camera's principal point must be finite");
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 4; ++row) {
      SPLATBOOST_CHECK(std::isfinite(camera.camera_from_world[column][row]), "a camera's pose must be finite");
    }
  }
  SPLATBOOST_CHECK(is_rigid(camera.camera_from_world),
                   "a camera's pose must be rigid, a rotation and a translation (is the matrix transposed?)");
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <glm/matrix.hpp>
#include <limits>

#include "splatboost/camera.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

Camera good_camera() {
  Camera camera{64, 48, 50, 50, 32, 24, glm::mat4(1.0f)};
  camera.camera_from_world[3] = {0.5f, -1.0f, 2.0f, 1.0f};
  return camera;
}

TEST(Camera, PosesThatAreNotRigidAreRefused) {
  EXPECT_NO_THROW(check_camera(good_camera()));
  Camera rounded = good_camera();
  rounded.camera_from_world[0][0] = 1.001f;
  EXPECT_NO_THROW(check_camera(rounded));

  Camera transposed = good_camera();
  transposed.camera_from_world = glm::transpose(transposed.camera_from_world);
  Camera scaled = good_camera();
  for (int column = 0; column < 3; ++column) scaled.camera_from_world[column] *= 3.0f;
  Camera mirrored = good_camera();
  mirrored.camera_from_world[0][0] = -1.0f;
  Camera zero = good_camera();
  zero.camera_from_world = glm::mat4(0.0f);
  Camera infinite = good_camera();
  infinite.camera_from_world[3][0] = std::numeric_limits<float>::infinity();
  for (const Camera& bad : {transposed, scaled, mirrored, zero, infinite}) {
    EXPECT_THROW(check_camera(bad), ArgumentError);
  }
}

}  // namespace
}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/scene_depths.h"

#include <gtest/gtest.h>

#include "support/looking_camera.h"

namespace splatboost {
namespace {

View view_at(const glm::vec3& centre) {
  View view;
  view.camera = testing::camera_along_z(centre);
  return view;
}

TEST(TypicalDepth, IsTheMedianOfTheViewsMedians) {
  Scene scene;
  EXPECT_EQ(typical_depth(scene), 1.0);
  scene.train = {view_at({0, 0, 0}), view_at({0, 0, -2}), view_at({0, 0, 100})};  // the last sees nothing
  for (const float z : {3.0f, 4.0f, 9.0f}) scene.points.positions.insert(scene.points.positions.end(), {0, 0, z});
  scene.points.positions.insert(scene.points.positions.end(), {90, 0, 1});  // outside of all views
  EXPECT_EQ(typical_depth(scene), 6.0) << "of 4 and 6";
}

TEST(ShareNearer, IsOfThePointsInTheViews) {
  Scene scene;
  EXPECT_EQ(share_nearer(scene, 1), 0);
  scene.train = {view_at({0, 0, 0}), view_at({0, 0, -2})};
  scene.points.positions = {0, 0, 1, 0, 0, 3, 0, 0, -1, 90, 0, 1};  // in 2 and 3 places
  EXPECT_EQ(share_nearer(scene, 2), 0.4) << "1 and 1 of 1, 3, 3, 5 and 1";
}

TEST(TypicalDepth, OfManyViewsAndPointsIsThatOfAnEvenSubset) {
  Scene scene;
  scene.train.assign(5000, view_at({0, 0, 0}));
  for (int i = 0; i < 500000; ++i) {
    scene.points.positions.insert(scene.points.positions.end(), {0, 0, 1 + 1e-5f * static_cast<float>(i)});
  }
  EXPECT_NEAR(typical_depth(scene), 3.5, 1e-3);
}

}  // namespace
}  // namespace splatboost

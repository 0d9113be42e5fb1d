// SPDX-License-Identifier: Apache-2.0
#include "pgsr/neighbor_views.h"

#include <gtest/gtest.h>

#include <cmath>

#include "support/looking_camera.h"

namespace splatboost {
namespace {

View view_at(glm::vec3 centre, double degrees = 0) {
  View view;
  view.camera = testing::camera_along_z(centre, degrees);
  return view;
}

using Lists = std::vector<std::vector<std::size_t>>;

TEST(NeighborViews, are_the_nearest_that_look_the_same_way) {
  const std::vector<View> views = {view_at({0, 0, 0}),        view_at({1, 0, 0}, 10), view_at({0.5f, 0, 0}, 29),
                                   view_at({0.2f, 0, 0}, 31), view_at({2, 0, 0}),     view_at({0.005f, 0, 0})};
  const Lists found = neighbor_views(views, {8, 30, 0.01, 1.5});
  EXPECT_EQ(found[0], (std::vector<std::size_t>{2, 1})) << "by distance; not one that looks away, is far or too near";
  EXPECT_EQ(found[4], (std::vector<std::size_t>{1})) << "1.5 is too far";
  EXPECT_EQ(neighbor_views(views, {1, 30, 0.01, 1.5})[0], (std::vector<std::size_t>{2}));
  EXPECT_TRUE(neighbor_views(views, {8, 30, 3, 5})[0].empty());
}

TEST(NeighborViews, equal_distances_go_by_angle) {
  const std::vector<View> views = {view_at({0, 0, 0}), view_at({1, 0, 0}, 20), view_at({-1, 0, 0}, 5),
                                   view_at({0, 1, 0}, 5)};
  EXPECT_EQ(neighbor_views(views, {8, 30, 0.01, 1.5})[0], (std::vector<std::size_t>{2, 3, 1}));
}

TEST(VirtualView, is_near_and_has_no_photo) {
  View near = view_at({1, 2, 3});
  near.color.assign(3 * 100 * 80, 7);
  double farthest = 0;
  for (std::uint64_t i = 0; i < 50; ++i) {
    const View view = virtual_view(near, 0.5, 20, RandomStream(1, i, RandomPurpose::virtual_camera));
    EXPECT_TRUE(view.color.empty());
    const double distance = static_cast<double>(glm::length(view.camera.centre() - near.camera.centre()));
    farthest = std::max(farthest, distance);
    EXPECT_LE(distance, 0.5 * std::sqrt(3.0) + 1e-5);
    const glm::mat3 turn = view.camera.rotation() * glm::transpose(near.camera.rotation());
    EXPECT_GT(turn[0][0] + turn[1][1] + turn[2][2], 1 + 2 * std::cos(60 * 3.14159265 / 180));
    EXPECT_NEAR(glm::determinant(turn), 1, 1e-5);
  }
  EXPECT_GT(farthest, 0.3);
}

}  // namespace
}  // namespace splatboost

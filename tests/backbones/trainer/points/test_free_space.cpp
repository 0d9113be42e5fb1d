// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/free_space.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <glm/geometric.hpp>

#include "splatboost/threads.h"
#include "trainer/features/view_features.h"
#include "trainer/points/backdrop_points.h"
#include "trainer/points/gap_points.h"
#include "trainer/points/points_in_picture.h"

namespace splatboost::test {
namespace {

constexpr int kWidth = 64, kHeight = 48;
constexpr double kFocal = 96, kSpacing = 0.05;  // 4 px

/// A camera at `x`, turned towards +z, whose picture has one grey value.
class Pictures : public ::testing::Test {
 protected:
  Pictures() {
    view_.camera.width = kWidth;
    view_.camera.height = kHeight;
    view_.camera.fx = view_.camera.fy = kFocal;
    view_.camera.cx = kWidth / 2.0f;
    view_.camera.cy = kHeight / 2.0f;
  }
  ViewFeatures at(double x, std::uint8_t grey) const {
    ViewFeatures picture = reduced_camera(view_, kWidth, kHeight, 1, 1);
    picture.centre.x = x;
    picture.grey.assign(std::size_t{kWidth} * kHeight, grey);
    return picture;
  }
  View view_;
};

using FreeSpaceOfViews = Pictures;
using BackdropPoints = Pictures;

/// Points of a wall at a depth of 4, up to this x.
std::vector<glm::dvec3> wall(double right) {
  std::vector<glm::dvec3> points;
  for (double y = -1; y <= 1; y += 0.1) {
    for (double x = -2; x <= right; x += 0.1) points.emplace_back(x, y, 4);
  }
  return points;
}

TEST_F(FreeSpaceOfViews, IsInFrontOfKnownPointsThatLookDifferent) {
  // The second camera sees a pixel of the first one 48 / depth px farther to the left.
  const auto contains = [&](std::uint8_t there, const glm::dvec2& pixel, double depth, double right) {
    const std::vector<ViewFeatures> views{at(0, 128), at(0.5, there)};
    return FreeSpace(views, wall(right), kSpacing, Threads(1)).contains(0, pixel, depth);
  };
  const glm::dvec2 left(28.5, 24.5), right(60.5, 24.5);
  EXPECT_TRUE(contains(200, left, 3, 0)) << "it would hide the wall";
  EXPECT_TRUE(contains(60, left, 3, 0)) << "also a darker one";
  EXPECT_FALSE(contains(128, left, 3, 0)) << "the other view shows the same";
  EXPECT_FALSE(contains(140, left, 3, 0)) << "nearly, as noise and exposures make it";
  EXPECT_TRUE(contains(200, left, 3.75, 0)) << "more than 5 % in front of the wall";
  EXPECT_FALSE(contains(200, left, 3.85, 0)) << "as good as on the wall";
  EXPECT_FALSE(contains(200, left, 8, 0)) << "hidden by the wall";
  EXPECT_FALSE(contains(200, right, 3, 0)) << "nothing is known to be behind it";
  EXPECT_TRUE(contains(200, right, 3, 2)) << "now something is";
}

TEST_F(FreeSpaceOfViews, IsNotKnownFromMaskedPixelsAndOneView) {
  std::vector<ViewFeatures> views{at(0, 128), at(0.5, 200)};
  const glm::dvec2 pixel(28.5, 24.5);
  EXPECT_TRUE(FreeSpace(views, wall(0), kSpacing, Threads(1)).contains(0, pixel, 3));
  EXPECT_FALSE(FreeSpace(views, {}, kSpacing, Threads(1)).contains(0, pixel, 3)) << "without known points";
  views[1].valid.assign(views[1].grey.size(), 0);
  EXPECT_FALSE(FreeSpace(views, wall(0), kSpacing, Threads(1)).contains(0, pixel, 3)) << "masked";
  views.pop_back();
  EXPECT_FALSE(FreeSpace(views, wall(0), kSpacing, Threads(1)).contains(0, pixel, 3)) << "one view";
}

TEST_F(FreeSpaceOfViews, ViewsMayDifferInSize) {
  ViewFeatures small = at(0.5, 200);
  small.width /= 2, small.height /= 2;
  small.fx /= 2, small.fy /= 2, small.cx /= 2, small.cy /= 2;
  small.grey.resize(small.grey.size() / 4);
  const std::vector<ViewFeatures> views{at(0, 128), small};
  const FreeSpace free_space(views, wall(0), kSpacing, Threads(1));
  EXPECT_TRUE(free_space.contains(0, {28.5, 24.5}, 3));
  EXPECT_TRUE(free_space.contains(1, {8.5, 12.5}, 3));
  EXPECT_FALSE(free_space.contains(1, {8.5, 12.5}, 4));
  EXPECT_FALSE(backdrop_points(views, wall(0), kSpacing, 0, Threads()).empty());
}

TEST_F(FreeSpaceOfViews, HasNoPointsInGaps) {
  // One known point is near, and the photos agree best at its depth of 3, where the other view shows the wall.
  std::vector<ViewFeatures> views{at(0, 128), at(0.5, 128)};
  for (std::size_t i = 0; i < views[1].grey.size(); ++i) {
    if (i % kWidth < kWidth / 2) views[1].grey[i] = i % kWidth < 9 ? 180 : 200;
  }
  std::vector<glm::dvec3> known;
  for (const glm::dvec3& p : wall(0)) {
    if (std::abs(p.y) < 0.55) known.push_back(p);
  }
  known.push_back(views[0].at_depth({28.2, 42.5}, 3));
  const FreeSpace free_space(views, known, kSpacing, Threads(1));
  ASSERT_TRUE(free_space.contains(0, {22, 42}, 3));
  const auto gaps = fill_gaps(views, known, {{0, 1}}, kSpacing, 0, Threads());
  EXPECT_GT(gaps.size(), 30u);
  for (const GapPoint& point : gaps) {
    EXPECT_FALSE(point.view == 0 && glm::length(point.pixel - glm::dvec2(22, 42)) < 1) << "it hides the wall";
    EXPECT_FALSE(free_space.contains(point.view, point.pixel, views[point.view].to_camera(point.position).z));
  }
}

TEST_F(BackdropPoints, LieBehindAllCamerasAndPointsWhereNothingElseIs) {
  const std::vector<ViewFeatures> views{at(-1, 128), at(1, 128)};
  const std::vector<glm::dvec3> known = wall(0);
  const auto points = backdrop_points(views, known, kSpacing, 0, Threads());
  ASSERT_GT(points.size(), 30u);
  double farthest = 0;
  for (const glm::dvec3& p : known) farthest = std::max(farthest, glm::length(p));
  for (const GapPoint& point : points) {
    const double radius = glm::length(point.position);  // the cameras' mean is at 0
    EXPECT_NEAR(radius, glm::length(points.front().position), 1e-9) << "all on one sphere";
    EXPECT_GT(radius, 1.5 * farthest);
    const auto pixel = views[point.view].projected(point.position);
    ASSERT_TRUE(pixel);
    EXPECT_NEAR(glm::length(pixel->pixel - point.pixel), 0, 1e-9) << "on its pixel's ray";
    for (const glm::dvec3& p : known) {
      const auto shown = views[point.view].projected(p);
      if (shown) {
        EXPECT_GE(glm::length(shown->pixel - point.pixel), PictureGrid(views[0], kSpacing).spacing);
      }
    }
  }
  std::vector<glm::dvec3> all = known;
  for (const GapPoint& point : points) all.push_back(point.position);
  EXPECT_EQ(backdrop_points(views, all, kSpacing, 0, Threads()).size(), 0u);
}

TEST_F(BackdropPoints, EncloseCamerasThatAreFartherApartThanThePoints) {
  const std::vector<ViewFeatures> views{at(-50, 128), at(50, 128)};
  const auto points = backdrop_points(views, wall(0), kSpacing, 0, Threads());
  ASSERT_FALSE(points.empty());
  for (const GapPoint& point : points) EXPECT_GT(glm::length(point.position), 75);
}

TEST_F(BackdropPoints, LeaveOutMasksAndTheBackground) {
  ViewFeatures picture = at(0, 128);
  const auto count = [&](std::uint8_t background) {
    return backdrop_points({picture}, wall(0), kSpacing, background, Threads()).size();
  };
  EXPECT_GT(count(0), 30u);
  picture.grey.assign(picture.grey.size(), 5);
  EXPECT_EQ(count(0), 0u) << "renders are black there without any point";
  EXPECT_GT(count(255), 30u);
  picture.grey.assign(picture.grey.size(), 250);
  EXPECT_EQ(count(255), 0u);
  EXPECT_GT(count(0), 30u);
  picture.valid.assign(picture.grey.size(), 0);
  EXPECT_EQ(count(0), 0u);
}

TEST_F(BackdropPoints, AreNotWhereAnotherViewShowsTheBackground) {
  std::vector<ViewFeatures> views{at(0, 128), at(0, 128)};
  const auto count = [&] {
    const auto points = backdrop_points(views, wall(0), kSpacing, 0, Threads());
    return std::ranges::count_if(points, [](const GapPoint& point) { return point.pixel.x > kWidth / 2; });
  };
  const auto all = count();
  ASSERT_GT(all, 20);
  for (std::size_t i = 0; i < views[1].grey.size(); ++i) {
    if (i % kWidth > kWidth / 2) views[1].grey[i] = 3;
  }
  EXPECT_EQ(count(), 0) << "one of the views must be wrong; renders show the background by themselves";
  views[1].valid.assign(views[1].grey.size(), 0);
  EXPECT_EQ(count(), all) << "masked pixels show nothing";
}

TEST_F(BackdropPoints, NeedASizeOfTheScene) {
  EXPECT_TRUE(backdrop_points({at(0, 128)}, {}, kSpacing, 0, Threads()).empty());
  EXPECT_TRUE(backdrop_points({}, wall(0), kSpacing, 0, Threads()).empty());
}

}  // namespace
}  // namespace splatboost::test

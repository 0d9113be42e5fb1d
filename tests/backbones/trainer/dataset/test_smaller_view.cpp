// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/smaller_view.h"

#include <gtest/gtest.h>

#include <vector>

namespace splatboost::test {
namespace {

View numbered_view(int width, int height) {
  View view;
  view.name = "a.png";
  view.time = 0.5f;
  view.camera.width = width;
  view.camera.height = height;
  view.camera.fx = 30;
  view.camera.fy = 20;
  view.camera.cx = 2.5f;
  view.camera.cy = 1.5f;
  for (int i = 0; i < 3 * width * height; ++i) view.color.push_back(static_cast<std::uint8_t>(i));
  return view;
}

TEST(SmallerView, AveragesBlocksAndWidensPixels) {
  const View half = smaller_view(numbered_view(5, 2), 2);
  EXPECT_EQ(half.camera.width, 2);
  EXPECT_EQ(half.camera.height, 1);
  EXPECT_EQ(half.camera.fx, 15);
  EXPECT_EQ(half.camera.fy, 10);
  EXPECT_EQ(half.camera.cx, 1.25f);
  EXPECT_EQ(half.camera.cy, 0.75f);
  // Rows of red are 0 1 2 3 4 and 5 6 7 8 9: (0+1+5+6)/4 = 3, (2+3+7+8)/4 = 5; the fifth column fills no block.
  EXPECT_EQ(half.color, (std::vector<std::uint8_t>{3, 5, 13, 15, 23, 25}));
  EXPECT_TRUE(half.valid.empty());
  EXPECT_EQ(half.name, "a.png");
  EXPECT_EQ(half.time, 0.5f);
}

TEST(SmallerView, IsValidWhereAllOfABlockIs) {
  View view = numbered_view(4, 2);
  view.valid = {1, 1, 1, 0, 1, 1, 1, 1};
  EXPECT_EQ(smaller_view(view, 2).valid, (std::vector<std::uint8_t>{1, 0}));
}

TEST(SmallerView, AtTheTrainedScaleIsTheView) {
  const View view = numbered_view(3, 2);
  const View same = smaller_view(view, 1);
  EXPECT_EQ(same.color, view.color);
  EXPECT_EQ(same.camera.cx, view.camera.cx);
}

TEST(HalfViews, AreTheViewsInTheirOrder) {
  Threads threads(2);
  std::vector<View> views;
  for (const int width : {2 * kMinHalfSide, 300, 400}) views.push_back(numbered_view(width, 2 * kMinHalfSide));
  const std::vector<View> halves = half_views(views, threads);
  ASSERT_EQ(halves.size(), views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_EQ(halves[i].color, smaller_view(views[i], 2).color);
    EXPECT_EQ(halves[i].camera.width, views[i].camera.width / 2);
  }
}

TEST(HalfViews, OfPicturesThatAreTooSmallThereAreNone) {
  Threads threads(1);
  const std::vector<View> views = {numbered_view(300, 300), numbered_view(300, 2 * kMinHalfSide - 1)};
  EXPECT_TRUE(half_views(views, threads).empty());
}

}  // namespace
}  // namespace splatboost::test

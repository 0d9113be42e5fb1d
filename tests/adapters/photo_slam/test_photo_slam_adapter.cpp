// SPDX-License-Identifier: Apache-2.0
// The decisions for a set of views that grows, on hand-made counts.
#include "photo_slam/photo_slam_adapter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "photo_slam/recent_views.h"
#include "splatboost/errors.h"
#include "support/fake_rasterizer.h"
#include "support/given_counts.h"

namespace splatboost {
namespace {

using testing::GivenCounts;
using testing::Hand;

TEST(RecentViews, are_the_newest_and_some_of_the_rest) {
  const RandomStream random(1, 2, RandomPurpose::scored_views);
  const std::vector<std::size_t> views = recent_and_drawn_views(40, 10, 0.5, random);
  ASSERT_EQ(views.size(), 10u);
  EXPECT_TRUE(std::ranges::is_sorted(views));
  EXPECT_EQ(std::vector<std::size_t>(views.end() - 5, views.end()), (std::vector<std::size_t>{35, 36, 37, 38, 39}));
  EXPECT_LT(views[4], 35u);
  EXPECT_EQ(std::ranges::adjacent_find(views), views.end());
  EXPECT_NE(views, recent_and_drawn_views(40, 10, 0.5, RandomStream(1, 3, RandomPurpose::scored_views)));
}

TEST(RecentViews, of_few_all_are_taken) {
  const RandomStream random(1, 2, RandomPurpose::scored_views);
  EXPECT_EQ(recent_and_drawn_views(3, 10, 0.5, random), (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_EQ(recent_and_drawn_views(7, 10, 0.5, random), (std::vector<std::size_t>{0, 1, 2, 3, 4, 5, 6}));
  EXPECT_TRUE(recent_and_drawn_views(0, 10, 0.5, random).empty());
}

/// Ten views. The first primitive has 8 flagged pixels in each of them, the second 16 in the newest alone, which is the
/// only one that sees it; the third is seen by all of them and has as many flagged pixels as the second.
GivenCounts growing_set() {
  std::vector<std::vector<std::int32_t>> counts(3, std::vector<std::int32_t>(10, 0));
  std::ranges::fill(counts[0], 8);
  counts[1][9] = counts[2][9] = 16;
  GivenCounts rasterizer(counts, 10, 1000, 1000);  // a megapixel: tau_d is whole
  rasterizer.drawn = counts;
  std::ranges::fill(rasterizer.drawn[2], 16);
  return rasterizer;
}

Hand all_would_grow() {
  Hand hand;
  hand.gradients.assign(3, 1);
  hand.gradients_abs.assign(3, 1);
  hand.opacities.assign(3, 0.5f);
  hand.max_scales.assign(3, 0.001f);
  return hand;
}

std::vector<std::uint8_t> grown(const PhotoSlamBoost& boost) {
  Threads threads(1);
  PhotoSlamAdapter adapter(boost, threads);
  GivenCounts rasterizer = growing_set();
  const Hand hand = all_would_grow();
  std::vector<std::uint8_t> clone(3, 1), split(3, 0);
  GrowDecisions decisions{clone, split};
  adapter.grow(hand.at(1000), rasterizer, decisions);
  return clone;
}

TEST(PhotoSlamAdapter, counts_are_of_the_views_that_see_a_primitive) {
  EXPECT_EQ(grown({}), (std::vector<std::uint8_t>{1, 1, 0}));
}

TEST(PhotoSlamAdapter, literally_counts_are_of_all_views) {
  PhotoSlamBoost literal = literal_photo_slam_boost();
  literal.percent_dense = 0.01;
  EXPECT_EQ(grown(literal), (std::vector<std::uint8_t>{1, 0, 0}));
}

TEST(PhotoSlamAdapter, the_newest_views_are_scored) {
  Threads threads(1);
  PhotoSlamAdapter adapter({}, threads);
  GivenCounts rasterizer({{1}, {1}}, 60, 8, 8);
  Hand hand;
  hand.gradients.assign(2, 0);
  hand.gradients_abs = hand.gradients;
  hand.opacities.assign(2, 0.5f);
  hand.max_scales = hand.opacities;
  std::vector<std::uint8_t> clone(2), split(2);
  GrowDecisions decisions{clone, split};
  adapter.grow(hand.at(1000), rasterizer, decisions);
  ASSERT_EQ(rasterizer.rendered.size(), 10u);
  for (std::size_t v = 55; v < 60; ++v) {
    EXPECT_NE(std::ranges::find(rasterizer.rendered, v), rasterizer.rendered.end()) << v;
  }
}

TEST(PhotoSlamAdapter, impossible_settings_are_named) {
  Threads threads(1);
  PhotoSlamBoost boost;
  boost.recent_share = 1.5;
  try {
    PhotoSlamAdapter adapter(boost, threads);
    FAIL();
  } catch (const ArgumentError& error) {
    EXPECT_NE(std::string(error.what()).find("recent_share"), std::string::npos);
  }
}

}  // namespace
}  // namespace splatboost

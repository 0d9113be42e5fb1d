// SPDX-License-Identifier: Apache-2.0
// The decisions for a growing set of views, on hand-written counts.
#include "photo_slam/photo_slam_adapter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <utility>
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

/// Ten views. Primitive 0 has 8 flagged pixels in each of them. Primitive 1 has 16 in the newest view, the only one to
/// see it. Primitive 2 has the same flagged pixels but is seen by all views.
GivenCounts growing_set() {
  std::vector<std::vector<std::int32_t>> counts(3, std::vector<std::int32_t>(10, 0));
  std::ranges::fill(counts[0], 8);
  counts[1][9] = counts[2][9] = 16;
  GivenCounts rasterizer(counts, 10, 1000, 1000);  // a megapixel: tau_d is not scaled down
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

/// Iterations of late pruning, and whether anything grows after the first of them.
struct Late {
  std::vector<int> prunes;
  bool grows_after = false;
};

template <class Plan>
Late late_pruning(const PhotoSlamBoost& boost, int iterations, Plan&& total) {
  Threads threads(1);
  PhotoSlamAdapter adapter(boost, threads);
  GivenCounts rasterizer({{1}, {1}}, 12, 8, 8);
  Hand hand = all_would_grow();
  hand.opacities.resize(2);
  Late late;
  for (int i = 1; i <= iterations; ++i) {
    const Moment moment{i, total(i)};
    late.grows_after = late.grows_after || (!late.prunes.empty() && adapter.grows_at(moment, false));
    if (!adapter.prunes_at(moment, false)) continue;
    late.prunes.push_back(i);
    std::vector<std::uint8_t> remove(2, 0);
    PruneDecisions decisions{remove, PruneRule::late, {}};
    DensityStatistics statistics;
    statistics.moment = moment;
    statistics.opacities = hand.opacities;
    adapter.prune(statistics, rasterizer, decisions);
  }
  return late;
}

TEST(PhotoSlamAdapter, a_fixed_plan_prunes_late_where_vanilla_does) {
  Threads threads(1);
  PhotoSlamBoost early, longer;
  early.late_prune_from = 6000;  // growth ends later
  longer.densify_until = 21000;  // after the first late pruning would be due
  for (const auto& [boost, wanted] : {std::pair{PhotoSlamBoost{}, std::vector<int>{500, 600, 700, 800, 900}},
                                      {early, {500, 600, 700, 800, 900}},
                                      {longer, {700, 800, 900}}}) {
    const VanillaAdapter vanilla(boost, threads);
    std::vector<int> expected;
    for (int i = 1; i <= 1000; ++i) {
      if (vanilla.prunes_at({i, 1000}, false)) expected.push_back(i);
    }
    EXPECT_EQ(expected, wanted);
    const Late late = late_pruning(boost, 1000, [](int) { return 1000; });
    EXPECT_EQ(late.prunes, expected);
    EXPECT_FALSE(late.grows_after);
  }
  PhotoSlamBoost literal = literal_photo_slam_boost();
  EXPECT_EQ(late_pruning(literal, 1000, [](int) { return 1000; }).prunes, (std::vector<int>{600, 700, 800, 900}));
}

TEST(PhotoSlamAdapter, a_plan_that_changes_prunes_late_as_often) {
  PhotoSlamBoost boost;
  boost.densify_until = boost.late_prune_from = 15000;
  // The planned length goes up and down, from an iteration on that is past the middle of the new plan.
  const int wobbling[] = {990, 1100, 940, 1180, 960, 1012};
  const Late late = late_pruning(boost, 1000, [&](int i) { return i <= 600 ? 30000 : wobbling[i / 20 % 6]; });
  EXPECT_EQ(late.prunes.size(), 4u) << "two were due at once, as the plan became shorter";
  EXPECT_EQ(late.prunes.front(), 601);
  EXPECT_FALSE(late.grows_after);
  for (const int slope : {-1, 1}) {
    const Late shifting = late_pruning(boost, 1000, [&](int i) { return 1000 + slope * (1000 - i) / 2; });
    EXPECT_EQ(shifting.prunes.size(), 5u) << slope;
    EXPECT_FALSE(shifting.grows_after);
  }
}

TEST(PhotoSlamAdapter, a_run_that_is_continued_prunes_only_what_is_due_from_then) {
  Threads threads(1);
  const PhotoSlamAdapter adapter({}, threads);
  EXPECT_FALSE(adapter.prunes_at({650, 1000}, false));
  EXPECT_TRUE(adapter.prunes_at({700, 1000}, false));
}

/// Lets an adapter grow and prune as a backbone does, every 100 iterations, with this number of views, and returns the
/// iterations of late pruning and of the last growth.
template <class Views>
std::pair<std::vector<int>, int> phases(const PhotoSlamBoost& boost, int iterations, Views&& views) {
  Threads threads(1);
  PhotoSlamAdapter adapter(boost, threads);
  Hand hand = all_would_grow();
  hand.opacities.resize(2), hand.gradients.resize(2), hand.gradients_abs.resize(2), hand.max_scales.resize(2);
  std::vector<int> prunes;
  int grown_at = 0;
  for (int i = 100; i <= iterations; i += 100) {
    GivenCounts rasterizer({{1}, {1}}, views(i), 8, 8);
    DensityStatistics statistics = hand.at(i);
    statistics.moment = {i, iterations};
    if (adapter.grows_at(statistics.moment, true)) {
      grown_at = i;
      std::vector<std::uint8_t> clone(2), split(2);
      GrowDecisions decisions{clone, split};
      adapter.grow(statistics, rasterizer, decisions);
    }
    if (!adapter.prunes_at(statistics.moment, false)) continue;
    prunes.push_back(i);
    std::vector<std::uint8_t> remove(2, 0);
    PruneDecisions decisions{remove, PruneRule::late, {}};
    adapter.prune(statistics, rasterizer, decisions);
  }
  return {prunes, grown_at};
}

TEST(PhotoSlamAdapter, growth_goes_on_after_the_last_view) {
  const PhotoSlamBoost boost;
  const auto growing = [](int last) {
    return [last](int i) { return static_cast<std::size_t>(10 + std::min(i, last)); };
  };
  const std::vector<int> usual = {10000, 12000, 15000, 18000, 21000, 24000, 27000};
  EXPECT_EQ(phases(boost, 30000, growing(0)), std::pair(usual, 9900)) << "all views are there from the start";
  EXPECT_EQ(phases(boost, 30000, growing(6000)), std::pair(usual, 9900)) << "the last view arrives early";
  EXPECT_EQ(phases(boost, 30000, growing(15000)), std::pair(std::vector<int>{18000, 21000, 24000, 27000}, 17900));
  EXPECT_EQ(phases(boost, 30000, growing(26000)), std::pair(std::vector<int>{27000}, 26900)) << "a quarter of the rest";
  PhotoSlamBoost literal = literal_photo_slam_boost();
  EXPECT_EQ(phases(literal, 30000, growing(20000)).second, 14500) << "the paper's iterations";
}

TEST(PhotoSlamAdapter, growth_starts_again_with_a_view_after_a_pause) {
  const auto late_view = [](int i) { return static_cast<std::size_t>(i > 16000 ? 11 : 10); };
  const auto [prunes, grown_at] = phases({}, 30000, late_view);
  EXPECT_EQ(prunes, (std::vector<int>{10000, 12000, 15000, 18000, 21000, 24000, 27000}));
  EXPECT_EQ(grown_at, 20900) << "the view is noticed at the pruning at 18000";
}

TEST(PhotoSlamAdapter, may_be_asked_about_later_iterations) {
  Threads threads(1);
  const PhotoSlamAdapter adapter({}, threads);
  EXPECT_TRUE(adapter.prunes_at({900, 1000}, false));
  EXPECT_FALSE(adapter.prunes_at({499, 1000}, false));
  EXPECT_TRUE(adapter.grows_at({400, 1000}, true));
  EXPECT_TRUE(adapter.prunes_at({500, 1000}, false));
}

TEST(PhotoSlamAdapter, late_pruning_may_begin_at_any_iteration) {
  Threads threads(1);
  PhotoSlamBoost boost;
  boost.late_prune_from = std::numeric_limits<int>::max();
  boost.late_prune_interval = 1;
  const PhotoSlamAdapter adapter(boost, threads);
  EXPECT_FALSE(adapter.prunes_at({650, 1000}, false));
}

TEST(PhotoSlamAdapter, higher_bands_have_one_rate_for_any_number_of_keyframes) {
  Threads threads(1);
  for (const int views : {0, 7, 500}) {
    PhotoSlamBoost boost;
    boost.training_views = views;
    EXPECT_EQ(PhotoSlamAdapter(boost, threads).rate_factor("f_rest", {100, 5000}), 4) << views;
  }
  EXPECT_EQ(PhotoSlamAdapter(literal_photo_slam_boost(), threads).rate_factor("f_rest", {100, 5000}), 1);
}

TEST(PhotoSlamAdapter, impossible_settings_are_named) {
  Threads threads(1);
  PhotoSlamBoost share, after_view;
  share.recent_share = 1.5;
  after_view.densify_after_view = -1;
  for (const auto& [boost, name] : {std::pair{share, "recent_share"}, {after_view, "densify_after_view"}}) {
    try {
      PhotoSlamAdapter adapter(boost, threads);
      FAIL() << name;
    } catch (const ArgumentError& error) {
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace splatboost

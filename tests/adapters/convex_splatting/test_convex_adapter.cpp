// SPDX-License-Identifier: Apache-2.0
// The convex adapter on hand-written counts.
#include "convex_splatting/convex_adapter.h"

#include <gtest/gtest.h>

#include <numeric>

#include "splatboost/errors.h"
#include "support/fake_rasterizer.h"

namespace splatboost {
namespace {

using testing::FakeRasterizer;
using testing::Hand;

std::vector<std::uint8_t> gated(const ConvexBoost& boost, const std::vector<std::int32_t>& counts, int width,
                                int height, std::vector<std::uint8_t> split) {
  Threads threads(1);
  ConvexAdapter adapter(boost, threads);
  FakeRasterizer rasterizer(counts, 3, width, height);
  std::vector<std::uint8_t> clone(counts.size(), 0);
  const std::vector<float> ones(counts.size(), 1.0f);
  const Hand hand{ones, ones, ones, ones};
  GrowDecisions decisions{clone, split};
  adapter.grow(hand.at(1000), rasterizer, decisions);
  return split;
}

TEST(ConvexAdapter, AsksForFiveTimesTheImportanceBecauseASplitAddsFive) {
  // At a megapixel and more: (τ_d + 1) · 5 = 30.
  EXPECT_EQ(gated({}, {28, 29, 30, 30}, 1000, 1000, {1, 1, 1, 0}), (std::vector<std::uint8_t>{0, 0, 1, 0}));
  EXPECT_EQ(gated({}, {29, 30}, 2000, 1000, {1, 1}), (std::vector<std::uint8_t>{0, 1}));
  // Half of that area asks for 15; the threshold is never below 1 for each added convex.
  EXPECT_EQ(gated({}, {14, 15, 15}, 1000, 500, {1, 1, 0}), (std::vector<std::uint8_t>{0, 1, 0}));
  EXPECT_EQ(gated({}, {4, 5, 5}, 400, 250, {1, 1, 0}), (std::vector<std::uint8_t>{0, 1, 0}));
  EXPECT_EQ(gated({}, {4, 5, 5}, 100, 100, {1, 1, 0}), (std::vector<std::uint8_t>{0, 1, 0}));
  EXPECT_EQ(gated(literal_convex_boost(), {5, 6, 6}, 100, 100, {1, 1, 0}), (std::vector<std::uint8_t>{0, 1, 0}));
  ConvexBoost without;
  without.vcd = false;
  EXPECT_EQ(gated(without, {0, 0}, 100, 100, {1, 0}), (std::vector<std::uint8_t>{1, 0}));
}

TEST(ConvexAdapter, ComparesTheMeanOverViewsAsItIs) {
  Threads threads(1);
  ConvexAdapter adapter({}, threads);
  // 0.25 megapixels ask for 7.5 pixels per view: 15 over two views are enough.
  testing::GivenCounts rasterizer({{7, 7}, {7, 8}}, 2, 500, 500);
  const std::vector<float> ones(2, 1.0f);
  const Hand hand{ones, ones, ones, ones};
  std::vector<std::uint8_t> clone(2, 0), split(2, 1);
  GrowDecisions decisions{clone, split};
  adapter.grow(hand.at(1000), rasterizer, decisions);
  EXPECT_EQ(split, (std::vector<std::uint8_t>{0, 1}));
}

TEST(ConvexAdapter, ThinsWhatGrowthRemovesAndLeavesTrimsAlone) {
  Threads threads(1);
  ConvexAdapter adapter({}, threads);
  const std::vector<float> ones(4, 1.0f), opacities{0.02f, 0.5f, 0.02f, 0.5f};
  const Hand hand{ones, ones, opacities, ones};
  FakeRasterizer rasterizer({0, 1, 2, 3});
  std::vector<std::uint8_t> clone(4, 0), split(4, 0);
  GrowDecisions growth{clone, split};
  adapter.grow(hand.at(1000), rasterizer, growth);
  // The children of primitive 3 have the highest score and are drawn first.
  std::vector<std::uint8_t> remove{1, 1, 1, 1, 0, 0};
  const std::vector<std::uint32_t> origins{0, 0, 3, 3, 1, 2};
  PruneDecisions within{remove, PruneRule::growth, origins};
  adapter.prune(hand.at(1000), rasterizer, within);
  EXPECT_EQ(remove, (std::vector<std::uint8_t>{0, 0, 1, 1, 0, 0}));

  std::vector<std::uint8_t> trimmed{1, 0, 1, 1};
  PruneDecisions trim{trimmed, PruneRule::trim, {}};
  adapter.prune(hand.at(18000), rasterizer, trim);
  EXPECT_EQ(trimmed, (std::vector<std::uint8_t>{1, 0, 1, 1}));
  EXPECT_THROW(adapter.prune(hand.at(1200), rasterizer, within), ArgumentError) << "no growth was scored there";

  const Hand fewer{{1, 1}, {1, 1}, {0.5f, 0.5f}, {1, 1}};
  FakeRasterizer of_fewer({0, 1});
  std::vector<std::uint8_t> late(2, 0);
  PruneDecisions without{remove, PruneRule::growth, {}}, last{late, PruneRule::late, {}};
  adapter.grow(hand.at(18000), rasterizer, growth);
  EXPECT_THROW(adapter.prune(hand.at(18000), rasterizer, without), ArgumentError);
  adapter.prune(fewer.at(18000), of_fewer, last);
  EXPECT_THROW(adapter.prune(hand.at(18000), rasterizer, within), ArgumentError) << "the scores are late ones";
}

TEST(ConvexAdapter, PrunesLateByTheReleasesOpacityAndByTheScore) {
  Threads threads(1);
  const std::vector<float> ones(5, 1.0f), opacities{0.029f, 0.031f, 0.099f, 0.5f, 0.5f};
  const Hand hand{ones, ones, opacities, ones};
  for (const bool literal : {false, true}) {
    ConvexAdapter adapter(literal ? literal_convex_boost() : ConvexBoost{}, threads);
    FakeRasterizer rasterizer({0, 0, 0, 1, 10});
    EXPECT_TRUE(adapter.prunes_at({18000, 30000}, false));
    EXPECT_FALSE(adapter.prunes_at({17000, 30000}, false));
    EXPECT_FALSE(adapter.prunes_at({30000, 30001}, false)) << "nothing would be left to recover in";
    EXPECT_EQ(adapter.prunes_at({12000, 30000}, false), !literal);
    EXPECT_TRUE(adapter.prunes_at({17000, 30000}, true));
    std::vector<std::uint8_t> remove(5, 0);
    PruneDecisions late{remove, PruneRule::late, {}};
    adapter.prune(hand.at(18000), rasterizer, late);
    const std::uint8_t faint = literal ? 1 : 0;
    EXPECT_EQ(remove, (std::vector<std::uint8_t>{1, faint, faint, 0, 1}));
  }
}

TEST(ConvexAdapter, OpacitiesOfAShortRunNeedNotHaveSettled) {
  Threads threads(1);
  const std::vector<float> ones(4, 1.0f), opacities{0.007f, 0.008f, 0.031f, 0.5f};
  Hand hand{ones, ones, opacities, ones};
  ConvexAdapter adapter({}, threads);
  // Each of the 4 views is trained on 25 times.
  FakeRasterizer rasterizer({0, 0, 0, 0}, 4);
  std::vector<std::uint8_t> remove(4, 0);
  PruneDecisions late{remove, PruneRule::late, {}};
  DensityStatistics statistics = hand.at(60);
  statistics.moment.total = 100;
  adapter.prune(statistics, rasterizer, late);
  EXPECT_EQ(remove, (std::vector<std::uint8_t>{1, 0, 0, 0}));
}

TEST(ConvexAdapter, TheLeastShownGoOnceWhenGrowthHasEnded) {
  Threads threads(1);
  const std::vector<float> ones(5, 1.0f), opacities(5, 0.5f);
  const Hand hand{ones, ones, opacities, ones};
  const auto removed = [&](ConvexBoost boost, int iteration) {
    ConvexAdapter adapter(boost, threads);
    EXPECT_TRUE(adapter.prunes_at({iteration, 30000}, false));
    FakeRasterizer rasterizer({0, 0, 0, 0, 0});
    rasterizer.weights = {0, 7, 400, 12, 581};  // 2 % of the sum is 20
    std::vector<std::uint8_t> remove(5, 0);
    PruneDecisions late{remove, PruneRule::late, {}};
    adapter.prune(hand.at(iteration), rasterizer, late);
    return remove;
  };
  EXPECT_EQ(removed({}, 10000), (std::vector<std::uint8_t>{0, 1, 0, 1, 0})) << "what no view shows is not known";
  EXPECT_EQ(removed({}, 12000), (std::vector<std::uint8_t>{0, 0, 0, 0, 0}));
  ConvexBoost none;
  none.late_share = 0;
  EXPECT_EQ(removed(none, 10000), (std::vector<std::uint8_t>{0, 0, 0, 0, 0}));
  ConvexAdapter literal(literal_convex_boost(), threads);
  EXPECT_FALSE(literal.prunes_at({10000, 30000}, false));
}

TEST(ConvexAdapter, SchedulesAllGroupsAndKeepsTheBackbonesResets) {
  Threads threads(1);
  ConvexAdapter adapter({}, threads);
  for (const char* group : {"convex_points", "delta", "sigma", "opacity", "mask", "f_dc"}) {
    EXPECT_TRUE(adapter.steps_at(group, {101, 30000})) << group;
    EXPECT_FALSE(adapter.steps_at(group, {16001, 30000})) << group;
    EXPECT_TRUE(adapter.steps_at(group, {16000, 30000})) << group;
    EXPECT_TRUE(adapter.steps_at(group, {25600, 30000})) << group;
    EXPECT_TRUE(adapter.steps_at(group, {30000, 30000})) << group;
  }
  EXPECT_FALSE(adapter.steps_at("f_rest", {101, 30000}));
  EXPECT_TRUE(adapter.steps_at("f_rest", {112, 30000}));
  EXPECT_TRUE(adapter.resets_opacities_at({9000, 30000}, true));
  EXPECT_FALSE(adapter.resets_opacities_at({9000, 30000}, false));
  EXPECT_FALSE(adapter.needs_absolute_gradients());
  EXPECT_EQ(adapter.beta(), 1.0f);
  EXPECT_EQ(ConvexAdapter(literal_convex_boost(), threads).beta(), 0.5f);
}

TEST(ConvexAdapter, HigherBandsHaveTheRateOfVanilla) {
  Threads threads(1);
  const auto factor = [&](ConvexBoost boost, int views, const char* group = "f_rest") {
    boost.training_views = views;
    return ConvexAdapter(boost, threads).rate_factor(group, {100, 7000});
  };
  EXPECT_EQ(factor({}, 0), 2) << "the number of views is not known";
  EXPECT_EQ(factor({}, 70), 2) << "100 uses";
  EXPECT_FLOAT_EQ(factor({}, 100), 200.0f / 70) << "70 uses";
  EXPECT_EQ(factor({}, 255), 4) << "27 uses";
  for (const char* group : {"f_dc", "convex_points", "sigma"}) EXPECT_EQ(factor({}, 255, group), 1) << group;
  ConvexBoost boost;
  boost.schedule = false;
  EXPECT_EQ(factor(boost, 255), 1);
  boost = literal_convex_boost();
  boost.schedule = true;
  EXPECT_EQ(factor(boost, 255), 1);
}

TEST(ConvexAdapter, NamesASettingThatIsImpossible) {
  const auto message = [](auto change) {
    ConvexBoost boost;
    change(boost);
    try {
      check(boost);
    } catch (const ArgumentError& error) {
      return std::string(error.what());
    }
    return std::string("nothing");
  };
  EXPECT_NE(message([](ConvexBoost& b) { b.beta = 0; }).find("beta"), std::string::npos);
  EXPECT_NE(message([](ConvexBoost& b) { b.tau_d = -1; }).find("tau_d"), std::string::npos);
  EXPECT_NE(message([](ConvexBoost& b) { b.views = 0; }).find("views"), std::string::npos);
  EXPECT_NE(message([](ConvexBoost& b) { b.late_min_opacity = 2; }).find("late_min_opacity"), std::string::npos);
  EXPECT_NE(message([](ConvexBoost& b) { b.late_share = 1; }).find("late_share"), std::string::npos);
  EXPECT_NE(message([](ConvexBoost& b) { b.coarse_until = 2; }).find("coarse_until"), std::string::npos);
  EXPECT_NE(message([](ConvexBoost& b) { b.rest_rate = -1; }).find("rest_rate"), std::string::npos);
  EXPECT_NE(message([](ConvexBoost& b) { b.rest_rate_few = -1; }).find("rest_rate_few"), std::string::npos);
  EXPECT_NE(message([](ConvexBoost& b) { b.training_views = -1; }).find("training_views"), std::string::npos);
}

}  // namespace
}  // namespace splatboost

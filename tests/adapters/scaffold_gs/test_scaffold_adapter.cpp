// SPDX-License-Identifier: Apache-2.0
// The adapter on hand-made tensors: which (anchor, offset) slots may grow.
#include <gtest/gtest.h>

#include "../../support/given_counts.h"
#include "scaffold_gs/scaffold_adapter.h"

namespace splatboost {
namespace {

using Mask = std::vector<std::uint8_t>;

Mask gate(const ScaffoldBoost& boost, testing::GivenCounts& rasterizer, Mask wanted) {
  Threads threads(1);
  ScaffoldAdapter adapter(boost, threads);
  const std::vector<float> gradients(wanted.size(), 1.0f);
  GrowDecisions decisions{wanted, {}};
  adapter.grow({{1000, 30000}, 1.0f, gradients, {}, {}, {}}, rasterizer, decisions);
  return wanted;
}

TEST(ScaffoldAdapter, a_slot_grows_only_where_its_importance_exceeds_tau_d) {
  // Each of 10 views counts the same, so importance is that count. Its mean is below 3.5: τ_d is the paper's.
  testing::GivenCounts rasterizer({{5}, {6}, {9}, {0}, {7}, {6}, {1}, {1}, {1}, {1}, {1}, {1}, {1}}, 10, 8, 8);
  EXPECT_EQ(gate({}, rasterizer, {1, 1, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1}),
            (Mask{0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0}))
      << "the gate takes away, it never adds";
  EXPECT_EQ(rasterizer.rendered.size(), 10u);
}

TEST(ScaffoldAdapter, counts_are_summed_over_views_and_divided_by_k_whoever_drew_the_slot) {
  // Seen in one view of four only: ⌊23 / 4⌋ = 5 does not exceed the threshold, here the mean 5.5; ⌊24 / 4⌋ = 6 does.
  testing::GivenCounts rasterizer({{23, 0, 0, 0}, {24, 0, 0, 0}, {6, 6, 6, 5}, {6, 6, 6, 6}}, 4, 8, 8);
  ScaffoldBoost boost;
  boost.views = 4;
  boost.mean_importance = 5;
  EXPECT_EQ(gate(boost, rasterizer, {1, 1, 1, 1}), (Mask{0, 1, 0, 1}));
}

TEST(ScaffoldAdapter, tau_d_rises_with_the_mean_importance_of_the_slots_that_were_counted) {
  const std::vector<std::vector<std::int32_t>> counts{{2}, {4}, {30}, {60}, {0}, {0}, {0}};  // mean 24 of those above 0
  testing::GivenCounts rasterizer(counts, 10, 8, 8);
  const Mask all(counts.size(), 1);
  EXPECT_EQ(gate({}, rasterizer, all), (Mask{0, 0, 0, 1, 0, 0, 0})) << "5 · 24 / 3.5";
  ScaffoldBoost boost;
  boost.mean_importance = 5;
  EXPECT_EQ(gate(boost, rasterizer, all), (Mask{0, 0, 1, 1, 0, 0, 0})) << "the mean";
  boost.tau_d = 10;  // twice the mean
  EXPECT_EQ(gate(boost, rasterizer, all), (Mask{0, 0, 0, 1, 0, 0, 0}));
  boost.tau_d = 0.7;  // 3.36
  EXPECT_EQ(gate(boost, rasterizer, all), (Mask{0, 1, 1, 1, 0, 0, 0}));
}

TEST(ScaffoldAdapter, nothing_is_drawn_without_a_candidate_or_without_vcd) {
  testing::GivenCounts rasterizer({{0}, {0}}, 10, 8, 8);
  EXPECT_EQ(gate({}, rasterizer, {0, 0}), (Mask{0, 0}));
  ScaffoldBoost boost;
  boost.vcd = false;
  EXPECT_EQ(gate(boost, rasterizer, {1, 0}), (Mask{1, 0}));
  EXPECT_TRUE(rasterizer.rendered.empty());
}

TEST(ScaffoldAdapter, growth_and_pruning_keep_the_backbones_own_times) {
  Threads threads(1);
  const ScaffoldAdapter adapter({}, threads);
  EXPECT_TRUE(adapter.grows_at({1600, 30000}, true));
  EXPECT_FALSE(adapter.grows_at({1600, 30000}, false));
  EXPECT_FALSE(adapter.prunes_at({18000, 30000}, false)) << "VCP does not apply";
  EXPECT_EQ(adapter.beta(), 0.5f);
  ScaffoldBoost boost;
  boost.cb = false;
  EXPECT_EQ(ScaffoldAdapter(boost, threads).beta(), std::nullopt);
}

}  // namespace
}  // namespace splatboost

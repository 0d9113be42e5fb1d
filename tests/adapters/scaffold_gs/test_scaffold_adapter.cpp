// SPDX-License-Identifier: Apache-2.0
// The adapter on hand-written tensors: which (anchor, offset) slots may grow.
#include <gtest/gtest.h>

#include "scaffold_gs/scaffold_adapter.h"
#include "support/given_counts.h"

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

TEST(ScaffoldAdapter, a_slot_grows_where_its_share_of_flagged_pixels_is_a_quarter_above_that_of_all) {
  // In each of 10 views 1000 of 10,000 pixels are flagged: growth asks for a share above 1/8, whatever a slot's size.
  testing::GivenCounts rasterizer({{125}, {126}, {13}, {12}, {1}, {0}, {723}}, 10, 8, 8);
  rasterizer.drawn = {{1000}, {1000}, {100}, {100}, {4}, {0}, {7796}};
  EXPECT_EQ(gate({}, rasterizer, Mask(7, 1)), (Mask{0, 1, 1, 0, 1, 0, 0}));
  EXPECT_EQ(rasterizer.rendered.size(), 10u) << "each view rendered once";
  EXPECT_EQ(gate({}, rasterizer, {1, 0, 1, 1, 1, 1, 1}), (Mask{0, 0, 1, 0, 1, 0, 0}))
      << "the gate takes away, it never adds";

  ScaffoldBoost boost;
  boost.tau_d = 5.1;  // a share of 0.1275
  EXPECT_EQ(gate(boost, rasterizer, Mask(7, 1)), (Mask{0, 0, 1, 0, 1, 0, 0}));
  boost.tau_d = 3.7;  // a share of 0.0925
  EXPECT_EQ(gate(boost, rasterizer, Mask(7, 1)), (Mask{1, 1, 1, 1, 1, 0, 1}));
}

TEST(ScaffoldAdapter, views_that_do_not_draw_a_slot_say_nothing_of_it) {
  // The first three slots are of a fine level, drawn in one view of four. A fifth of all drawn pixels are flagged.
  testing::GivenCounts rasterizer({{20, 0, 0, 0}, {10, 0, 0, 0}, {3, 0, 0, 0}, {16, 17, 17, 17}}, 4, 8, 8);
  rasterizer.drawn = {{50, 0, 0, 0}, {50, 0, 0, 0}, {4, 0, 0, 0}, {99, 99, 99, 99}};
  ScaffoldBoost boost;
  boost.views = 4;
  EXPECT_EQ(gate(boost, rasterizer, {1, 1, 1, 1}), (Mask{1, 0, 0, 0}))
      << "the third has a large share, but not one flagged pixel a scored view";
}

TEST(ScaffoldAdapter, errors_are_dense_or_not_within_their_view) {
  // One bad pixel sets the scale of a view's errors: half of the first view is flagged, a twentieth of the second.
  testing::GivenCounts rasterizer({{55, 0}, {65, 0}, {0, 6}, {0, 7}, {380, 37}}, 2, 8, 8);
  rasterizer.drawn = {{100, 0}, {100, 0}, {0, 100}, {0, 100}, {800, 800}};
  ScaffoldBoost boost;
  boost.views = 2;
  EXPECT_EQ(gate(boost, rasterizer, {1, 1, 1, 1, 1}), (Mask{0, 1, 0, 1, 0}));
}

TEST(ScaffoldAdapter, masked_pixels_say_nothing_of_a_slot) {
  testing::GivenCounts rasterizer({{70}, {30}}, 10, 8, 8);
  rasterizer.drawn = {{100}, {100}};  // among the valid pixels only
  rasterizer.valid.assign(64, 1);
  std::fill_n(rasterizer.valid.begin(), 16, std::uint8_t{0});
  EXPECT_EQ(gate({}, rasterizer, {1, 1}), (Mask{1, 0}));
}

TEST(ScaffoldAdapter, nothing_flagged_lets_nothing_grow) {
  testing::GivenCounts rasterizer({{0}, {0}}, 10, 8, 8);
  rasterizer.drawn = {{9}, {0}};
  EXPECT_EQ(gate({}, rasterizer, {1, 1}), (Mask{0, 0}));
}

TEST(ScaffoldAdapter, the_literal_rule_counts_pixels_and_divides_by_k_whoever_drew_the_slot) {
  // ⌊23 / 4⌋ = 5 does not exceed τ_d, ⌊24 / 4⌋ = 6 does.
  testing::GivenCounts rasterizer({{23, 0, 0, 0}, {24, 0, 0, 0}, {6, 6, 6, 5}, {6, 6, 6, 6}, {400, 0, 0, 0}}, 4, 8, 8);
  ScaffoldBoost boost;
  boost.literal = true;
  boost.views = 4;
  EXPECT_EQ(gate(boost, rasterizer, {1, 1, 1, 1, 0}), (Mask{0, 1, 0, 1, 0}));
}

TEST(ScaffoldAdapter, nothing_is_drawn_without_a_candidate_or_without_vcd) {
  testing::GivenCounts rasterizer({{0}, {0}}, 10, 8, 8);
  EXPECT_EQ(gate({}, rasterizer, {0, 0}), (Mask{0, 0}));
  ScaffoldBoost boost;
  boost.vcd = false;
  EXPECT_EQ(gate(boost, rasterizer, {1, 0}), (Mask{1, 0}));
  EXPECT_TRUE(rasterizer.rendered.empty());
}

TEST(ScaffoldAdapter, rates_that_are_constant_as_published_fall_to_a_tenth_once_growth_has_ended) {
  Threads threads(1);
  const ScaffoldAdapter adapter({}, threads);
  for (const char* group : {"anchor_feat", "scaling", "mlp_cov"}) {
    EXPECT_EQ(adapter.rate_factor(group, {1, 30000}), 1.0f);
    EXPECT_EQ(adapter.rate_factor(group, {15000, 30000}), 1.0f);
    EXPECT_FLOAT_EQ(adapter.rate_factor(group, {22500, 30000}), 0.31622777f) << "the square root of a tenth";
    EXPECT_FLOAT_EQ(adapter.rate_factor(group, {30000, 30000}), 0.1f);
    EXPECT_TRUE(adapter.steps_at(group, {16, 30000}));
  }
  for (const char* group : {"offset", "mlp_opacity", "mlp_color", "mlp_featurebank", "embedding_appearance"}) {
    EXPECT_EQ(adapter.rate_factor(group, {30000, 30000}), 1.0f) << group << " falls as published";
  }
  ScaffoldBoost boost;
  boost.rates_fall_from = 0.75;
  EXPECT_EQ(ScaffoldAdapter(boost, threads).rate_factor("scaling", {22500, 30000}), 1.0f);
  EXPECT_FLOAT_EQ(ScaffoldAdapter(boost, threads).rate_factor("scaling", {30000, 30000}), 0.1f);
  boost.schedule = false;
  EXPECT_EQ(ScaffoldAdapter(boost, threads).rate_factor("scaling", {30000, 30000}), 1.0f);
}

TEST(ScaffoldAdapter, growth_and_pruning_keep_the_backbones_own_times) {
  Threads threads(1);
  const ScaffoldAdapter adapter({}, threads);
  EXPECT_TRUE(adapter.grows_at({1600, 30000}, true));
  EXPECT_FALSE(adapter.grows_at({1600, 30000}, false));
  EXPECT_FALSE(adapter.prunes_at({18000, 30000}, false)) << "VCP does not apply";
  EXPECT_EQ(adapter.beta(), 0.7f);
  ScaffoldBoost boost;
  boost.cb = false;
  EXPECT_EQ(ScaffoldAdapter(boost, threads).beta(), std::nullopt);
}

}  // namespace
}  // namespace splatboost

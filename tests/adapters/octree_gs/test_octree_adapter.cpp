// SPDX-License-Identifier: Apache-2.0
// The adapter on hand-made counts: a fine anchor is in few of the scored views.
#include <gtest/gtest.h>

#include "../../support/given_counts.h"
#include "octree_gs/octree_adapter.h"

namespace splatboost {
namespace {

using Mask = std::vector<std::uint8_t>;

Mask gate(bool level_aware, testing::GivenCounts& rasterizer) {
  Threads threads(1);
  OctreeBoost boost;
  boost.level_aware = level_aware;
  boost.slots_per_anchor = 2;
  boost.views = 4;
  OctreeAdapter adapter(boost, threads);
  const std::vector<float> gradients(rasterizer.primitives(), 1.0f);
  Mask clone(gradients.size(), 1);
  GrowDecisions decisions{clone, {}};
  adapter.grow({{1000, 30000}, 1.0f, gradients, {}, {}, {}}, rasterizer, decisions);
  return clone;
}

TEST(OctreeAdapter, the_level_aware_rule_divides_by_the_views_that_drew_the_anchor) {
  // τ_d = 5. Anchors of two slots; their counts in views 0 to 3.
  const std::vector<std::vector<std::int32_t>> counts{
      {6, 6, 6, 6},  {5, 5, 5, 5},   // in all views: both rules divide by 4
      {12, 0, 0, 0}, {0, 11, 0, 0},  // the anchor in two views: 12 / 2, 11 / 2
      {12, 0, 0, 0}, {11, 0, 0, 0},  // in one view: divided by 2 all the same
      {0, 0, 0, 0},  {0, 0, 0, 0},   // in none
      {8, 0, 8, 0},  {0, 0, 1, 1}};  // in three: 16 / 3 = 5
  testing::GivenCounts literal(counts, 4, 8, 8), aware(counts, 4, 8, 8);
  EXPECT_EQ(gate(false, literal), (Mask{1, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(gate(true, aware), (Mask{1, 0, 1, 0, 1, 0, 0, 0, 0, 0}));
  EXPECT_EQ(literal.rendered, aware.rendered) << "the same views, each rendered once";
}

TEST(OctreeAdapter, which_views_drew_an_anchor_does_not_depend_on_what_is_wrong_in_them) {
  // Two anchors; the second is drawn everywhere and keeps the mean of importance low. The first is wrong in one view,
  // but drawn in three.
  const std::vector<std::vector<std::int32_t>> flagged{{16, 0, 0, 0}, {0, 0, 0, 0}, {4, 4, 4, 4}, {4, 4, 4, 4}},
      drawn{{50, 9, 0, 0}, {0, 0, 7, 0}, {9, 9, 9, 9}, {9, 9, 9, 9}};
  testing::GivenCounts rasterizer(flagged, 4, 8, 8);
  rasterizer.drawn = drawn;
  EXPECT_EQ(gate(true, rasterizer), (Mask{0, 0, 0, 0})) << "16 / 3 = 5 does not exceed 5";
  rasterizer.drawn[1][2] = 0;
  EXPECT_EQ(gate(true, rasterizer), (Mask{1, 0, 0, 0})) << "16 / 2 = 8 exceeds 5, and the mean 5.3";
}

}  // namespace
}  // namespace splatboost

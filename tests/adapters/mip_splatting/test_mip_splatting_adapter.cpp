// SPDX-License-Identifier: Apache-2.0
// The adapter on hand-written tensors: absolute gradients are Mip-Splatting's sums, everything else is vanilla's.
#include "mip_splatting/mip_splatting_adapter.h"

#include <gtest/gtest.h>

#include <cmath>

#include "support/fake_rasterizer.h"

namespace splatboost {
namespace {

using testing::FakeRasterizer;
using testing::Hand;

VanillaBoost boost_at_paper_size() {
  VanillaBoost boost;
  boost.percent_dense = 0.01;
  return boost;
}

TEST(MipSplattingAdapter, splits_on_sums_at_the_threshold_that_is_told_as_a_length) {
  Threads threads(1);
  VanillaBoost boost = boost_at_paper_size();
  boost.vcd = boost.vcp = false;
  MipSplattingAdapter adapter(boost, threads);
  EXPECT_TRUE(adapter.needs_absolute_gradients());
  // A length of 6e-4 is a sum between 6e-4 (along an axis) and 8.5e-4 (along a diagonal).
  EXPECT_GT(kAbsoluteSumOverLength, 1.0);
  EXPECT_LT(kAbsoluteSumOverLength, std::sqrt(2.0));
  const auto border = static_cast<float>(6e-4 * kAbsoluteSumOverLength);
  //                  small+moving  small+still  large above    large below
  const Hand hand{{2e-4f, 1.9e-4f, 0.0f, 1.0f},
                  {0.0f, 1.0f, 1.0001f * border, 0.9999f * border},
                  {0.5f, 0.5f, 0.5f, 0.5f},
                  {0.05f, 0.05f, 0.2f, 0.2f}};
  std::vector<std::uint8_t> clone(4, 9), split(4, 9);
  GrowDecisions decisions{clone, split};
  FakeRasterizer rasterizer({0, 0, 0, 0});
  adapter.grow(hand.at(1000), rasterizer, decisions);
  EXPECT_EQ(clone, (std::vector<std::uint8_t>{1, 0, 0, 0}));
  EXPECT_EQ(split, (std::vector<std::uint8_t>{0, 0, 1, 0}));
}

TEST(MipSplattingAdapter, gates_growth_and_pruning_as_vanilla_does) {
  Threads threads(1);
  VanillaAdapter vanilla(boost_at_paper_size(), threads);
  MipSplattingAdapter mip(boost_at_paper_size(), threads);
  EXPECT_EQ(mip.beta(), vanilla.beta());
  for (int i = 1; i <= 30000; i += 7) {
    EXPECT_EQ(mip.grows_at({i, 30000}, false), vanilla.grows_at({i, 30000}, false));
    EXPECT_EQ(mip.prunes_at({i, 30000}, false), vanilla.prunes_at({i, 30000}, false));
    EXPECT_EQ(mip.steps_at("f_rest", {i, 30000}), vanilla.steps_at("f_rest", {i, 30000}));
  }
  // At a megapixel tau_d is 5: importances 5 and 6 lie on both sides of it.
  const Hand hand{{1, 1, 1, 1}, {1, 1, 1, 1}, {0.05f, 0.2f, 0.5f, 0.5f}, {0.05f, 0.05f, 0.2f, 0.2f}};
  FakeRasterizer rasterizer({5, 6, 5, 6}, 2, 1000, 1000);
  std::vector<std::uint8_t> clone(4), split(4);
  GrowDecisions grow{clone, split};
  mip.grow(hand.at(1000), rasterizer, grow);
  EXPECT_EQ(clone, (std::vector<std::uint8_t>{0, 1, 0, 0}));
  EXPECT_EQ(split, (std::vector<std::uint8_t>{0, 0, 0, 1}));
  std::vector<std::uint8_t> remove(4);
  PruneDecisions prune{remove, PruneRule::late, {}};
  FakeRasterizer late({0, 10, 95, 100});
  mip.prune(hand.at(18000), late, prune);
  EXPECT_EQ(remove, (std::vector<std::uint8_t>{1, 0, 1, 1})) << "faint, and scores above 0.9";
}

}  // namespace
}  // namespace splatboost

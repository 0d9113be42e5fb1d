// SPDX-License-Identifier: Apache-2.0
// Vanilla's rules under the settings for few views, on hand-made tensors.
#include "dropgaussian/dropgaussian_adapter.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "support/fake_rasterizer.h"

namespace splatboost {
namespace {

using testing::FakeRasterizer;
using testing::Hand;

TEST(DropGaussianAdapter, plan_is_of_the_published_run_of_10000) {
  Threads threads(1);
  const VanillaAdapter adapter(dropgaussian_boost(), threads);
  std::vector<int> growths, prunes;
  for (int i = 1; i <= 10000; ++i) {
    if (adapter.grows_at({i, 10000}, false)) growths.push_back(i);
    if (adapter.prunes_at({i, 10000}, false)) prunes.push_back(i);
    EXPECT_TRUE(adapter.steps_at("f_rest", {i, 10000})) << "plain Adam";
  }
  EXPECT_EQ(growths.size(), 18u);
  EXPECT_EQ(growths.front(), 1000);
  EXPECT_EQ(growths.back(), 9500);
  EXPECT_EQ(prunes, std::vector<int>{8000});
  EXPECT_TRUE(adapter.prunes_at({2400, 3000}, false)) << "it scales with the run";
}

TEST(DropGaussianAdapter, three_views_are_all_scored_and_splitting_needs_a_clear_sign) {
  Threads threads(1);
  VanillaAdapter adapter(dropgaussian_boost(), threads);
  // The border between small and large is 0.001 × extent. The scene covers half of the views: thresholds × √½.
  const float clone_from = 2e-4f * 0.70711f, split_from = 2.4e-3f * 0.70711f;
  const Hand hand{{1.001f * clone_from, 0.999f * clone_from, 0, 0, 1, 0},
                  {0, 0, 1.001f * split_from, 0.999f * split_from, 1, 1},
                  {0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f},
                  {0.005f, 0.005f, 0.2f, 0.2f, 0.005f, 0.2f}};
  FakeRasterizer rasterizer({9, 9, 9, 9, 0, 0}, 3);
  std::vector<std::uint8_t> clone(6), split(6);
  GrowDecisions decisions{clone, split};
  adapter.grow({{1000, 10000}, testing::kExtent, hand.gradients, hand.gradients_abs, hand.opacities, hand.max_scales},
               rasterizer, decisions);
  EXPECT_EQ(clone, (std::vector<std::uint8_t>{1, 0, 0, 0, 0, 0})) << "the last two err in no view";
  EXPECT_EQ(split, (std::vector<std::uint8_t>{0, 0, 1, 0, 0, 0}));
  std::sort(rasterizer.rendered.begin(), rasterizer.rendered.end());
  EXPECT_EQ(rasterizer.rendered, (std::vector<std::size_t>{0, 1, 2}));
}

}  // namespace
}  // namespace splatboost

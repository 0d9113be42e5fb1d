// SPDX-License-Identifier: Apache-2.0
// Vanilla's rules under the settings for few views, on hand-written tensors.
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
  const DropGaussianAdapter adapter(dropgaussian_boost(), threads);
  std::vector<int> growths, prunes, resets;
  for (int i = 1; i <= 10000; ++i) {
    if (adapter.grows_at({i, 10000}, false)) growths.push_back(i);
    if (adapter.prunes_at({i, 10000}, false)) prunes.push_back(i);
    if (adapter.resets_opacities_at({i, 10000}, i % 3000 == 0)) resets.push_back(i);
    EXPECT_TRUE(adapter.steps_at("f_rest", {i, 10000})) << "plain Adam";
  }
  EXPECT_EQ(growths, (std::vector<int>{832, 1248, 1664, 2080, 2496, 2912, 3328, 3744, 4160, 4576, 4992}))
      << "twelve intervals in the half of the run that grows";
  EXPECT_EQ(prunes, (std::vector<int>{5000, 6000, 7000, 8000, 9000}));
  EXPECT_TRUE(adapter.prunes_at({2400, 3000}, false)) << "it scales with the run";
  EXPECT_EQ(resets, std::vector<int>{3000}) << "none after growth has ended";
  EXPECT_FALSE(adapter.resets_opacities_at({500, 1010}, true)) << "late pruning at 505 would remove all but one";
  EXPECT_TRUE(adapter.resets_opacities_at({500, 1400}, true)) << "200 iterations before it";
  VanillaBoost boost = dropgaussian_boost();
  boost.vcd = false;
  EXPECT_FALSE(DropGaussianAdapter(boost, threads).resets_opacities_at({9000, 10000}, true))
      << "late pruning at 9000 and what follows would take all that is faint by the reset";
  boost.vcp = false;
  EXPECT_TRUE(DropGaussianAdapter(boost, threads).resets_opacities_at({9000, 10000}, true)) << "all is the backbone's";
}

TEST(DropGaussianAdapter, few_views_are_all_scored_and_the_fewer_the_clearer_a_sign_splitting_needs) {
  Threads threads(1);
  // The border between small and large is 0.001 × extent. The scene covers half of the pixels: thresholds × √½.
  const float clone_from = 2e-4f * 0.70711f;
  for (const auto& [views, threshold] : {std::pair{3, 2.4e-3f}, {6, 1.8e-3f}, {60, 1.26e-3f}}) {
    const float split_from = threshold * 0.70711f;
    const Hand hand{{1.001f * clone_from, 0.999f * clone_from, 0, 0, 1, 0},
                    {0, 0, 1.001f * split_from, 0.999f * split_from, 1, 1},
                    {0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f},
                    {0.005f, 0.005f, 0.2f, 0.2f, 0.005f, 0.2f}};
    FakeRasterizer rasterizer({9, 9, 9, 9, 0, 0}, static_cast<std::size_t>(views));
    std::vector<std::uint8_t> clone(6), split(6);
    GrowDecisions decisions{clone, split};
    DropGaussianAdapter adapter(dropgaussian_boost(), threads);
    adapter.grow({{1000, 10000}, testing::kExtent, hand.gradients, hand.gradients_abs, hand.opacities, hand.max_scales},
                 rasterizer, decisions);
    EXPECT_EQ(clone, (std::vector<std::uint8_t>{1, 0, 0, 0, 0, 0})) << "the last two err in no view";
    EXPECT_EQ(split, (std::vector<std::uint8_t>{0, 0, 1, 0, 0, 0})) << views << " views";
    std::sort(rasterizer.rendered.begin(), rasterizer.rendered.end());
    EXPECT_EQ(rasterizer.rendered.size(), static_cast<std::size_t>(std::min(views, 10)));
    EXPECT_EQ(std::adjacent_find(rasterizer.rendered.begin(), rasterizer.rendered.end()), rasterizer.rendered.end());
  }
}

}  // namespace
}  // namespace splatboost

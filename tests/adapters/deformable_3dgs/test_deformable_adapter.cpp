// SPDX-License-Identifier: Apache-2.0
// Vanilla's rules over the longer run of Deformable-3DGS, a net that always steps, candidates that no pixel shows.
#include "deformable_3dgs/deformable_adapter.h"

#include <gtest/gtest.h>

#include <numeric>

#include "support/fake_rasterizer.h"

namespace splatboost {
namespace {

TEST(DeformableAdapter, plan_is_of_the_published_run_of_40000) {
  Threads threads(1);
  const DeformableAdapter adapter(deformable_boost(), threads);
  int first = 0, last = 0;
  std::vector<int> prunes;
  for (int i = 1; i <= 40000; ++i) {
    if (adapter.grows_at({i, 40000}, false)) {
      if (first == 0) first = i;
      last = i;
    }
    if (adapter.prunes_at({i, 40000}, false)) prunes.push_back(i);
  }
  EXPECT_EQ(first, 600);
  EXPECT_EQ(last, 9900);
  EXPECT_EQ(prunes, (std::vector<int>{10000, 12000, 16000, 20000, 24000, 28000, 32000, 36000}))
      << "where growth ends, and to the end of the run";
  EXPECT_TRUE(adapter.prunes_at({18000, 20000}, false)) << "it scales with the run";
  EXPECT_FALSE(adapter.prunes_at({4000, 20000}, false));
}

TEST(DeformableAdapter, the_net_steps_at_every_iteration) {
  Threads threads(1);
  const DeformableAdapter adapter(deformable_boost(), threads);
  int of_gaussians = 0, of_rest = 0;
  for (int i = 1; i <= 40000; ++i) {
    ASSERT_TRUE(adapter.steps_at("deformation", {i, 40000}));
    of_gaussians += adapter.steps_at("xyz", {i, 40000});
    of_rest += adapter.steps_at("f_rest", {i, 40000});
  }
  // Until 15 000 every iteration (f_rest: every 16th), until 20 000 every 32nd, until the end every 64th; 40 000 is a
  // multiple of 64. Multiples of 32: 625 - 468, of 64: 625 - 312.
  EXPECT_EQ(of_gaussians, 15000 + 157 + 313);
  EXPECT_EQ(of_rest, 937 + 157 + 313);
}

TEST(DeformableAdapter, growth_is_of_the_backbones_own_candidates) {
  Threads threads(1);
  const std::vector<float> gradients(4, 1.0f), opacities(4, 0.5f), scales{0.001f, 0.5f, 0.001f, 0.5f};
  const DensityStatistics statistics{{600, 40000}, 1, gradients, gradients, opacities, scales};
  testing::FakeRasterizer rasterizer({9, 9, 0, 9});
  const auto grown = [&](const VanillaBoost& boost) {
    DeformableAdapter adapter(boost, threads);
    std::vector<std::uint8_t> clone{1, 0, 1, 0}, split{0, 1, 0, 0};
    GrowDecisions decisions{clone, split};
    adapter.grow(statistics, rasterizer, decisions);
    return std::pair(clone, split);
  };
  using Mask = std::vector<std::uint8_t>;
  EXPECT_EQ(grown(deformable_boost()), std::pair(Mask({1, 0, 0, 0}), Mask({0, 1, 0, 0})))
      << "those that errors ask for";
  VanillaBoost vanilla = deformable_boost();
  vanilla.absgrad = true;
  EXPECT_EQ(grown(vanilla).second, Mask({0, 1, 0, 1})) << "by vanilla's borders there would be more";
}

TEST(DeformableAdapter, candidates_that_no_pixel_shows_all_go_and_half_of_the_others) {
  Threads threads(1);
  constexpr std::size_t kCount = 100;
  // 40 candidates: 30 that cannot reach an alpha of 1/255, 10 that can. 20 more are as faint but kept by the backbone.
  std::vector<float> gradients(kCount), opacities(kCount, 0.5f), scales(kCount, 0.05f);
  std::vector<std::uint8_t> candidates(kCount, 0), clone(kCount), split(kCount);
  for (std::size_t i = 0; i < 60; ++i) {
    opacities[i] = i < 30 || i >= 40 ? 0.0039f : 0.0045f;
    candidates[i] = i < 40;
  }
  std::vector<std::uint32_t> origins(kCount);
  std::iota(origins.begin(), origins.end(), 0u);
  testing::FakeRasterizer rasterizer(std::vector<std::int32_t>(kCount, 1));
  DensityStatistics statistics{{600, 40000}, 1, gradients, gradients, opacities, scales};
  const auto removed = [&](const VanillaBoost& boost, PruneRule rule) {
    DeformableAdapter adapter(boost, threads);
    std::vector<std::uint8_t> remove = candidates;
    GrowDecisions grow{clone, split};
    PruneDecisions prune{remove, rule, origins};
    adapter.grow(statistics, rasterizer, grow);
    adapter.prune(statistics, rasterizer, prune);
    for (std::size_t i = 0; i < kCount; ++i) EXPECT_LE(remove[i], candidates[i]);
    const auto count = [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      return std::accumulate(remove.begin() + begin, remove.begin() + end, 0);
    };
    return std::pair(count(0, 30), count(30, 40));
  };
  EXPECT_EQ(removed(deformable_boost(), PruneRule::growth), std::pair(30, 5));
  EXPECT_EQ(removed(deformable_boost(), PruneRule::trim), std::pair(30, 10)) << "as the backbone says";
  VanillaBoost literal = deformable_boost();
  literal.literal = true;
  const auto [unseen, seen] = removed(literal, PruneRule::growth);
  EXPECT_EQ(unseen + seen, 20) << "the paper keeps half, whoever they are";
  EXPECT_LT(unseen, 30);
  VanillaBoost without = deformable_boost();
  without.vcp = false;
  EXPECT_EQ(removed(without, PruneRule::growth), std::pair(30, 10));
  statistics.opacities = {};
  const auto [some, others] = removed(deformable_boost(), PruneRule::growth);
  EXPECT_EQ(some + others, 20) << "a host that tells no opacities: half of all";
}

}  // namespace
}  // namespace splatboost

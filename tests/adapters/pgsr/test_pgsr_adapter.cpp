// SPDX-License-Identifier: Apache-2.0
// The adapter on hand-written tensors: vanilla's rules on the backbone's candidates; its trim is unchanged.
#include "pgsr/pgsr_adapter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <vector>

#include "support/fake_rasterizer.h"

namespace splatboost {
namespace {

using testing::FakeRasterizer;
using testing::Hand;

TEST(PgsrAdapter, grows_for_a_quarter_of_the_run) {
  Threads threads(1);
  PgsrAdapter pgsr(pgsr_boost(), threads);
  EXPECT_EQ(pgsr.beta(), 1.0f);
  for (int i = 1; i <= 30000; ++i) {
    EXPECT_EQ(pgsr.grows_at({i, 30000}, false), i > 500 && i < 7500 && i % 100 == 0) << i;
    EXPECT_EQ(pgsr.prunes_at({i, 30000}, false), i == 7500 || (i > 7500 && i < 30000 && i % 3000 == 0)) << i;
    EXPECT_TRUE(pgsr.steps_at("xyz", {i, 30000})) << "plain Adam";
  }
  for (const int i : {3000, 6000}) {
    EXPECT_TRUE(pgsr.resets_opacities_at({i, 30000}, true)) << i;
    EXPECT_FALSE(pgsr.resets_opacities_at({i, 30000}, false)) << i;
  }
}

TEST(PgsrAdapter, prunes_late_although_its_own_cap_is_reached) {
  Threads threads(1);
  PgsrAdapter pgsr(pgsr_boost(), threads);
  const Hand hand{{0, 0}, {}, {0.5f, 0.05f}, {}};
  FakeRasterizer rasterizer({1, 1});
  DensityStatistics statistics = hand.at(18000);
  statistics.max_primitives = 2;
  std::vector<std::uint8_t> remove(2, 0);
  PruneDecisions prune{remove, PruneRule::late, {}};
  pgsr.prune(statistics, rasterizer, prune);
  EXPECT_EQ(remove, (std::vector<std::uint8_t>{0, 1}));
}

TEST(PgsrAdapter, opacities_recover_before_late_pruning_in_runs_of_any_length) {
  Threads threads(1);
  const PgsrAdapter pgsr(pgsr_boost(), threads);
  // The backbone's resets: every tenth of the run, but at least 500 iterations apart.
  for (const int total : {1010, 2100, 5002, 7001, 12344, 30000}) {
    const int interval = std::max(scaled_iteration(3000, total), 500);
    int last_reset = -interval;
    for (int i = 1; i <= total; ++i) {
      if (pgsr.prunes_at({i, total}, false)) {
        ASSERT_GE(i - last_reset, 500) << total << " " << i;
      }
      if (pgsr.resets_opacities_at({i, total}, i % interval == 0)) last_reset = i;
    }
  }
}

TEST(PgsrAdapter, grows_the_backbones_own_candidates_that_errors_ask_for) {
  Threads threads(1);
  const Hand hand{{1, 1, 1, 1}, {1, 1, 1, 1}, {0.5f, 0.5f, 0.5f, 0.5f}, {0.001f, 0.5f, 0.001f, 0.5f}};
  FakeRasterizer rasterizer({9, 9, 0, 9}, 2);
  using Mask = std::vector<std::uint8_t>;
  const auto grown = [&](const VanillaBoost& boost) {
    PgsrAdapter adapter(boost, threads);
    Mask clone{1, 0, 1, 0}, split{0, 1, 0, 0};
    GrowDecisions decisions{clone, split};
    adapter.grow(hand.at(1000), rasterizer, decisions);
    return std::pair(clone, split);
  };
  EXPECT_EQ(grown(pgsr_boost()), std::pair(Mask{1, 0, 0, 0}, Mask{0, 1, 0, 0}));
  EXPECT_EQ(grown(literal_boost()), std::pair(Mask{1, 0, 0, 0}, Mask{0, 1, 0, 0}))
      << "the last exceeds the paper's threshold, but is no candidate: it may be small on screen";
}

TEST(PgsrAdapter, takes_half_of_the_backbones_candidates_and_nobody_else) {
  Threads threads(1);
  PgsrAdapter adapter(pgsr_boost(), threads);
  const std::size_t n = 40;
  const Hand hand{std::vector<float>(n, 0), std::vector<float>(n, 0), std::vector<float>(n, 0.5f),
                  std::vector<float>(n, 0.01f)};
  FakeRasterizer rasterizer(std::vector<std::int32_t>(n, 9), 2);
  std::vector<std::uint8_t> clone(n), split(n), remove(n, 0);
  GrowDecisions grow{clone, split};
  adapter.grow(hand.at(1000), rasterizer, grow);
  for (std::size_t i = 0; i < 10; ++i) remove[3 * i] = 1;
  const std::vector<std::uint8_t> candidates = remove;
  std::vector<std::uint32_t> origins(n);
  std::iota(origins.begin(), origins.end(), 0u);
  PruneDecisions prune{remove, PruneRule::growth, origins};
  adapter.prune(hand.at(1000), rasterizer, prune);
  EXPECT_EQ(std::accumulate(remove.begin(), remove.end(), 0), 5);
  for (std::size_t i = 0; i < n; ++i) EXPECT_LE(remove[i], candidates[i]) << i;
}

TEST(PgsrAdapter, lets_the_trim_go) {
  Threads threads(1);
  PgsrAdapter adapter(pgsr_boost(), threads);
  const Hand hand{{0, 0, 0}, {0, 0, 0}, {0.01f, 0.5f, 0.5f}, {0.01f, 0.01f, 0.01f}};
  FakeRasterizer rasterizer({9, 9, 9}, 2);
  // 18000 is also an iteration of late pruning.
  for (const int iteration : {1000, 18000}) {
    std::vector<std::uint8_t> remove{0, 1, 0};
    PruneDecisions prune{remove, PruneRule::trim, {}};
    adapter.prune(hand.at(iteration), rasterizer, prune);
    EXPECT_EQ(remove, (std::vector<std::uint8_t>{0, 1, 0})) << iteration;
  }
}

}  // namespace
}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
// The paper's rules, reimplemented from its supplement (Secs. 9.1 to 9.3), against each adapter's literal settings.
#include <gtest/gtest.h>

#include <string>

#include "registry/boost_settings.h"
#include "support/fake_rasterizer.h"

namespace splatboost {
namespace {

using testing::FakeRasterizer;
using testing::Hand;

const char* const kOfGaussians[] = {"vanilla",         "mip-splatting", "dropgaussian",
                                    "deformable-3dgs", "pgsr",          "photo-slam"};
const char* const kOfConvexes = "convex-splatting";
const char* const kOfAnchors[] = {"scaffold-gs", "octree-gs"};

std::unique_ptr<Adapter> literal(const char* backbone, const Threads& threads) {
  const std::unique_ptr<BoostSettings> settings = find_adapter(backbone).make_settings(true);
  EXPECT_EQ(settings->coarse_share(), 0) << "views have their full size all along";
  return settings->make_adapter(0, threads);
}

/// The iteration of a run of `total` that corresponds to `of_thirty_thousand` of the paper's 30 000 (15 000, 20 000 or
/// 3 000).
int share(int total, double of_thirty_thousand) { return static_cast<int>(total * of_thirty_thousand / 30000 + 0.5); }

TEST(Literal, gaussians_grow_every_500_iterations_in_the_first_half) {
  Threads threads(1);
  for (const int total : {3000, 7000, 30000, 40000}) {
    for (const char* backbone : {"vanilla", "mip-splatting", "pgsr", "photo-slam"}) {
      const auto adapter = literal(backbone, threads);
      for (int i = 1; i <= total; ++i) {
        const bool grows = i > share(total, 500) && i < share(total, 15000) && i % 500 == 0;
        ASSERT_EQ(adapter->grows_at({i, total}, i % 100 == 0), grows) << backbone << " " << total << " " << i;
      }
    }
  }
  // DropGaussian densifies to the end of its run of 10 000.
  const auto adapter = literal("dropgaussian", threads);
  for (int i = 1; i <= 10000; ++i) {
    ASSERT_EQ(adapter->grows_at({i, 10000}, i % 100 == 0), i > 500 && i < 10000 && i % 500 == 0) << i;
  }
}

TEST(Literal, moving_gaussians_have_the_same_rules_in_their_run_of_40000) {
  // The supplement (Sec. 9.2) trains Deformable-3DGS with VCD, VCP and the compact box of vanilla, and plain Adam.
  Threads threads(1);
  const auto adapter = literal("deformable-3dgs", threads);
  for (int i = 1; i <= 40000; ++i) {
    ASSERT_EQ(adapter->grows_at({i, 40000}, i % 100 == 0), i > 500 && i < 15000 && i % 500 == 0) << i;
    ASSERT_EQ(adapter->prunes_at({i, 40000}, false), i > 15000 && i < 40000 && i % 3000 == 0) << i;
  }
  EXPECT_TRUE(adapter->prunes_at({9000, 20000}, false)) << "it follows the length of the run";
  EXPECT_FALSE(adapter->prunes_at({7000, 20000}, false));
}

TEST(Literal, late_pruning_comes_every_tenth_of_the_run_after_its_half) {
  Threads threads(1);
  for (const int total : {7000, 30000}) {
    for (const char* backbone : {"vanilla", "mip-splatting", "pgsr", "photo-slam"}) {
      const auto adapter = literal(backbone, threads);
      for (int i = 1; i <= total; ++i) {
        const bool late = i > share(total, 15000) && i < total && i % share(total, 3000) == 0;
        ASSERT_EQ(adapter->prunes_at({i, total}, false), late) << backbone << " " << total << " " << i;
        ASSERT_TRUE(adapter->prunes_at({i, total}, true));
      }
    }
  }
  // DropGaussian's run is shorter than 15 000 iterations.
  const auto adapter = literal("dropgaussian", threads);
  for (int i = 1; i <= 10000; ++i) ASSERT_FALSE(adapter->prunes_at({i, 10000}, false)) << i;
}

TEST(Literal, resets_and_pruning_of_large_gaussians_are_the_backbones) {
  Threads threads(1);
  for (const char* backbone : kOfGaussians) {
    const auto adapter = literal(backbone, threads);
    for (int i = 100; i <= 7000; i += 100) {
      ASSERT_TRUE(adapter->prunes_large_at({i, 7000}, true));
      ASSERT_FALSE(adapter->prunes_large_at({i, 7000}, false));
      ASSERT_TRUE(adapter->resets_opacities_at({i, 7000}, true));
      ASSERT_FALSE(adapter->resets_opacities_at({i, 7000}, false));
    }
  }
}

TEST(Literal, only_3dgs_has_the_optimizer_schedule_and_its_intervals_do_not_shrink) {
  Threads threads(1);
  for (const int total : {7000, 30000}) {
    for (const AdapterEntry& entry : adapters()) {
      const auto adapter = literal(std::string(entry.backbone).c_str(), threads);
      for (int i = 1; i <= total; ++i) {
        for (const char* group : {"f_rest", "xyz", "scaling", "anchor_feat"}) {
          const int interval = i <= share(total, 15000)   ? (std::string(group) == "f_rest" ? 16 : 1)
                               : i <= share(total, 20000) ? 32
                                                          : 64;
          // The last iteration of a run applies the accumulated gradients.
          const bool steps = entry.backbone != "vanilla" || i == total || i % interval == 0;
          ASSERT_EQ(adapter->steps_at(group, {i, total}), steps) << entry.backbone << " " << group << " " << i;
          ASSERT_EQ(adapter->rate_factor(group, {i, total}), 1.0f);
        }
      }
    }
  }
}

TEST(Literal, beta_is_a_half) {
  Threads threads(1);
  for (const AdapterEntry& entry : adapters()) {
    EXPECT_EQ(literal(std::string(entry.backbone).c_str(), threads)->beta(), 0.5f) << entry.backbone;
  }
}

TEST(Literal, gaussians_grow_above_the_thresholds_and_five_whole_flagged_pixels) {
  Threads threads(1);
  // Two views of 8×8, half of whose pixels are matched exactly. Gaussians above 0.001 of the extent, 0.01, are large.
  // Columns: at the clone threshold, below it; at the split threshold, below it; only five flagged pixels, where more
  // are required.
  const Hand hand{{2e-4f, 1.99e-4f, 0, 1, 1},
                  {0, 1, 1.2e-3f, 1.19e-3f, 1},
                  {0.5f, 0.5f, 0.5f, 0.5f, 0.5f},
                  {0.005f, 0.005f, 0.02f, 0.02f, 0.02f}};
  for (const char* backbone : kOfGaussians) {
    const auto adapter = literal(backbone, threads);
    FakeRasterizer rasterizer({6, 6, 6, 6, 5}, 2);
    std::vector<std::uint8_t> clone(5, 1), split(5, 1);
    GrowDecisions decisions{clone, split};
    adapter->grow(hand.at(1000), rasterizer, decisions);
    EXPECT_EQ(clone, (std::vector<std::uint8_t>{1, 0, 0, 0, 0})) << backbone;
    EXPECT_EQ(split, (std::vector<std::uint8_t>{0, 0, 1, 0, 0})) << backbone;
  }
}

TEST(Literal, convexes_split_above_five_whole_flagged_pixels_and_prune_as_gaussians_do) {
  Threads threads(1);
  const auto adapter = literal(kOfConvexes, threads);
  FakeRasterizer rasterizer({6, 5, 60}, 2);
  std::vector<std::uint8_t> clone(3, 0), split{1, 1, 0};
  GrowDecisions decisions{clone, split};
  const Hand hand{{1, 1, 1}, {}, {0.09f, 0.11f, 0.5f}, {}};
  adapter->grow(hand.at(1000), rasterizer, decisions);
  EXPECT_EQ(split, (std::vector<std::uint8_t>{1, 0, 0})) << "only candidates of the backbone's own rule";
  for (const int total : {7000, 30000}) {
    for (int i = 1; i <= total; ++i) {
      const bool late = i > share(total, 15000) && i < total && i % share(total, 3000) == 0;
      ASSERT_EQ(adapter->prunes_at({i, total}, false), late) << total << " " << i;
      ASSERT_EQ(adapter->grows_at({i, total}, i % 200 == 0), i % 200 == 0) << "when the backbone does";
      ASSERT_EQ(adapter->resets_opacities_at({i, total}, i % 900 == 0), i % 900 == 0);
    }
  }
  std::vector<std::uint8_t> remove(3, 0);
  PruneDecisions pruned{remove, PruneRule::late, {}};
  adapter->prune(hand.at(18000), rasterizer, pruned);
  EXPECT_EQ(remove, (std::vector<std::uint8_t>{1, 0, 1})) << "an opacity below 0.1, a score above 0.9";
}

TEST(Literal, slots_of_anchors_grow_above_five_whole_flagged_pixels) {
  Threads threads(1);
  for (const char* backbone : kOfAnchors) {
    const auto adapter = literal(backbone, threads);
    FakeRasterizer rasterizer({6, 5, 60}, 2);
    std::vector<std::uint8_t> clone{1, 1, 0}, split;
    GrowDecisions decisions{clone, split};
    adapter->grow(Hand{{1, 1, 1}, {}, {}, {}}.at(1000), rasterizer, decisions);
    EXPECT_EQ(clone, (std::vector<std::uint8_t>{1, 0, 0})) << backbone << ": only candidates of its own rule";
  }
}

}  // namespace
}  // namespace splatboost

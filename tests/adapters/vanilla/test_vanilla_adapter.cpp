// SPDX-License-Identifier: Apache-2.0
// The adapter on hand-written tensors: which primitives are cloned, split and pruned.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "support/fake_rasterizer.h"
#include "vanilla/vanilla_adapter.h"

namespace splatboost {
namespace {

using testing::FakeRasterizer;
using testing::Hand;

VanillaBoost boost_at_paper_size() {
  VanillaBoost boost;
  boost.percent_dense = 0.01;
  return boost;
}

class VanillaAdapterTest : public ::testing::Test {
 protected:
  Threads threads_{1};
};

TEST_F(VanillaAdapterTest, clones_on_the_signed_and_splits_on_the_absolute_gradient) {
  VanillaBoost boost = boost_at_paper_size();
  boost.vcd = boost.vcp = false;
  VanillaAdapter adapter(boost, threads_);
  //                  small+moving  small+still  large+abs   large+signed only
  const Hand hand{
      {2e-4f, 1.9e-4f, 0.0f, 1.0f}, {0.0f, 1.0f, 6e-4f, 5.9e-4f}, {0.5f, 0.5f, 0.5f, 0.5f}, {0.05f, 0.05f, 0.2f, 0.2f}};
  std::vector<std::uint8_t> clone(4, 9), split(4, 9);
  GrowDecisions decisions{clone, split};
  FakeRasterizer rasterizer({0, 0, 0, 0});
  adapter.grow(hand.at(1000), rasterizer, decisions);
  EXPECT_EQ(clone, (std::vector<std::uint8_t>{1, 0, 0, 0}));
  EXPECT_EQ(split, (std::vector<std::uint8_t>{0, 0, 1, 0}));
  EXPECT_TRUE(rasterizer.rendered.empty()) << "nothing is scored when neither VCD nor VCP is on";
}

TEST_F(VanillaAdapterTest, without_absolute_gradients_the_backbones_rule_stands) {
  VanillaBoost boost = boost_at_paper_size();
  boost.vcd = boost.vcp = boost.absgrad = false;
  VanillaAdapter adapter(boost, threads_);
  const Hand hand{{1, 1}, {}, {0.5f, 0.5f}, {0.05f, 0.2f}};
  std::vector<std::uint8_t> clone{0, 1}, split{1, 0};
  GrowDecisions decisions{clone, split};
  FakeRasterizer rasterizer({0, 0});
  adapter.grow(hand.at(1000), rasterizer, decisions);
  EXPECT_EQ(clone, (std::vector<std::uint8_t>{0, 1}));
  EXPECT_EQ(split, (std::vector<std::uint8_t>{1, 0}));
  EXPECT_FALSE(adapter.needs_absolute_gradients());
}

TEST_F(VanillaAdapterTest, a_cap_ranks_by_what_accepts_relative_to_its_threshold) {
  VanillaBoost boost = boost_at_paper_size();
  boost.vcd = boost.vcp = false;
  VanillaAdapter adapter(boost, threads_);
  // Thresholds are 2e-4 signed for small Gaussians and 6e-4 absolute for large ones.
  const Hand hand{{4e-4f, 5e-4f, 1e-3f}, {9e-3f, 1.8e-3f, 6e-4f}, {0.5f, 0.5f, 0.5f}, {0.05f, 0.2f, 0.2f}};
  std::vector<std::uint8_t> clone(3), split(3);
  std::vector<float> priorities{7, 7, 7};
  GrowDecisions decisions{clone, split, priorities};
  FakeRasterizer rasterizer({0, 0, 0});
  adapter.grow(hand.at(1000), rasterizer, decisions);
  EXPECT_FLOAT_EQ(priorities[0], 2);
  EXPECT_FLOAT_EQ(priorities[1], 3);
  EXPECT_FLOAT_EQ(priorities[2], 1);

  boost.absgrad = false;  // the backbone's rule and its ranking stay
  VanillaAdapter same(boost, threads_);
  priorities = {7, 8, 9};
  same.grow(hand.at(1000), rasterizer, decisions);
  EXPECT_EQ(priorities, (std::vector<float>{7, 8, 9}));
}

TEST_F(VanillaAdapterTest, tau_d_is_the_papers_at_the_papers_sizes_and_shrinks_with_the_area_below) {
  const Hand hand{{1, 1, 1, 1, 1}, {}, {}, {}};
  const auto grown = [&](int width, int height) {
    VanillaBoost boost = boost_at_paper_size();
    boost.absgrad = false;  // all are candidates of the backbone
    VanillaAdapter adapter(boost, threads_);
    FakeRasterizer rasterizer({0, 2, 3, 5, 6}, 2, width, height);  // flagged pixels in each of two views
    std::vector<std::uint8_t> clone(5, 1), split(5, 0);
    GrowDecisions decisions{clone, split};
    adapter.grow(hand.at(1000), rasterizer, decisions);
    return clone;
  };
  using Mask = std::vector<std::uint8_t>;
  EXPECT_EQ(grown(1000, 1000), (Mask{0, 0, 0, 0, 1}));  // at least 6
  EXPECT_EQ(grown(1600, 1066), (Mask{0, 0, 0, 0, 1}));  // 6, the paper's larger photos
  EXPECT_EQ(grown(1000, 500), (Mask{0, 0, 1, 1, 1}));   // 3
  EXPECT_EQ(grown(1000, 510), (Mask{0, 0, 0, 1, 1}));   // 3.06: the threshold is not rounded down
  EXPECT_EQ(grown(500, 500), (Mask{0, 1, 1, 1, 1}));    // 1.5
  EXPECT_EQ(grown(8, 8), (Mask{0, 1, 1, 1, 1}));        // 1, the minimum
}

TEST_F(VanillaAdapterTest, gradients_are_judged_by_the_part_of_the_image_that_the_scene_covers) {
  VanillaAdapter adapter(boost_at_paper_size(), threads_);
  // Half of each view is empty background, rendered exactly: thresholds are those at full coverage × √½.
  const float clone_from = 2e-4f * 0.70711f, split_from = 6e-4f * 0.70711f;
  const Hand hand{{1.001f * clone_from, 0.999f * clone_from, 0, 0},
                  {0, 0, 1.001f * split_from, 0.999f * split_from},
                  {0.5f, 0.5f, 0.5f, 0.5f},
                  {0.05f, 0.05f, 0.2f, 0.2f}};
  FakeRasterizer rasterizer({9, 9, 9, 9});
  std::vector<std::uint8_t> clone(4), split(4);
  GrowDecisions decisions{clone, split};
  adapter.grow(hand.at(1000), rasterizer, decisions);
  EXPECT_EQ(clone, (std::vector<std::uint8_t>{1, 0, 0, 0}));
  EXPECT_EQ(split, (std::vector<std::uint8_t>{0, 0, 1, 0}));
}

TEST_F(VanillaAdapterTest, an_appended_primitive_is_judged_by_what_it_was_made_from) {
  VanillaBoost boost = boost_at_paper_size();
  boost.vcd = false;
  VanillaAdapter adapter(boost, threads_);
  // One of two candidates is removed. Primitive 0 has all of the score, primitive 1 none; after growth the candidates
  // are row 0 (made from 1) and row 1 (made from 0): row 1 must be the one removed, whatever the random numbers.
  const Hand hand{{0, 0}, {0, 0}, {0.0045f, 0.0045f}, {0.05f, 0.05f}};
  std::vector<std::uint8_t> clone(2), split(2), remove{1, 1};
  const std::vector<std::uint32_t> origins{1, 0};
  GrowDecisions grow{clone, split};
  FakeRasterizer rasterizer({100, 0});
  for (int iteration = 500; iteration < 10000; iteration += 500) {
    remove = {1, 1};
    adapter.grow(hand.at(iteration), rasterizer, grow);
    PruneDecisions prune{remove, PruneRule::growth, origins};
    adapter.prune(hand.at(iteration), rasterizer, prune);
    EXPECT_EQ(remove, (std::vector<std::uint8_t>{0, 1}));
  }
}

TEST_F(VanillaAdapterTest, half_of_the_candidates_go_and_no_other) {
  VanillaBoost boost = boost_at_paper_size();
  boost.vcd = false;
  VanillaAdapter adapter(boost, threads_);
  const std::size_t n = 101;
  Hand hand;
  hand.gradients.assign(n, 0);
  hand.gradients_abs.assign(n, 0);
  hand.opacities.assign(n, 0.0045f);
  hand.max_scales.assign(n, 0.05f);
  std::vector<std::int32_t> counts(n);
  std::iota(counts.begin(), counts.end(), 0);
  FakeRasterizer rasterizer(counts);
  std::vector<std::uint8_t> clone(n), split(n), remove(n, 0);
  for (std::size_t i = 0; i < 40; ++i) remove[2 * i] = 1;
  const std::vector<std::uint8_t> candidates = remove;
  std::vector<std::uint32_t> origins(n);
  std::iota(origins.begin(), origins.end(), 0u);
  GrowDecisions grow{clone, split};
  PruneDecisions prune{remove, PruneRule::growth, origins};
  adapter.grow(hand.at(1000), rasterizer, grow);
  adapter.prune(hand.at(1000), rasterizer, prune);
  EXPECT_EQ(std::count(remove.begin(), remove.end(), 1), 20);
  for (std::size_t i = 0; i < n; ++i) EXPECT_LE(remove[i], candidates[i]);
}

TEST_F(VanillaAdapterTest, opacities_are_reset_while_primitives_grow) {
  VanillaBoost boost = boost_at_paper_size();
  const auto resets = [&] {
    const VanillaAdapter adapter(boost, threads_);
    std::vector<int> at;
    for (int i = 3000; i <= 30000; i += 3000) {
      if (adapter.resets_opacities_at({i, 30000}, true)) at.push_back(i);
    }
    EXPECT_FALSE(adapter.resets_opacities_at({3001, 30000}, false)) << "when is the backbone's to say";
    return at;
  };
  EXPECT_EQ(resets(), (std::vector<int>{})) << "free space around the cameras replaces them";
  boost.growth_after_reset = 3000;
  EXPECT_EQ(resets(), (std::vector<int>{3000})) << "growth ends at 7500";
  boost.densify_until = 10000;
  EXPECT_EQ(resets(), (std::vector<int>{3000, 6000}));
  boost.vcd = false;
  EXPECT_EQ(resets(), (std::vector<int>{3000, 6000, 9000, 12000})) << "to where the backbone's growth ends";
}

TEST_F(VanillaAdapterTest, opacities_are_reset_only_where_they_can_recover) {
  // 3DGS would reset at every tenth of the run. Growth, which ends at a quarter of it, must last long enough after it.
  const auto resets = [&](const VanillaBoost& boost, int total) {
    const VanillaAdapter adapter(boost, threads_);
    std::vector<int> at;
    for (int i = total / 10; i <= total; i += total / 10) {
      if (adapter.resets_opacities_at({i, total}, true)) at.push_back(i);
    }
    return at;
  };
  VanillaBoost boost = boost_at_paper_size();
  EXPECT_EQ(resets(boost, 30000), (std::vector<int>{}));
  boost.growth_after_reset = 3000;
  EXPECT_EQ(resets(boost, 20000), (std::vector<int>{2000}));
  EXPECT_EQ(resets(boost, 19000), (std::vector<int>{})) << "1900 + 3000 is above 4750";
  // Random points leave Gaussians around the cameras, which resets remove; 200 iterations are enough to recover.
  boost.random_points = true;
  EXPECT_EQ(resets(boost, 7000), (std::vector<int>{700, 1400})) << "growth ends at 1750";
  EXPECT_EQ(resets(boost, 4000), (std::vector<int>{400, 800})) << "1200 + 200 is above 1268";
  boost.random_points = false;
  boost.growth_after_reset = 1;
  EXPECT_EQ(resets(boost, 7000), (std::vector<int>{700, 1400})) << "growth ends at 1750";
  boost.vcd = boost.vcp = false;
  EXPECT_EQ(resets(boost, 7000).size(), 10u) << "all is the backbone's";
}

TEST_F(VanillaAdapterTest, late_pruning_removes_the_faint_and_the_worst) {
  VanillaAdapter adapter(boost_at_paper_size(), threads_);
  EXPECT_FALSE(adapter.prunes_at({7499, 30000}, false));
  EXPECT_TRUE(adapter.prunes_at({7500, 30000}, false)) << "growth has ended";
  EXPECT_FALSE(adapter.prunes_at({7501, 30000}, false));
  EXPECT_FALSE(VanillaAdapter(literal_boost(), threads_).prunes_at({7500, 30000}, false));
  EXPECT_TRUE(adapter.prunes_at({18000, 30000}, false));
  EXPECT_TRUE(adapter.prunes_at({27000, 30000}, false));
  EXPECT_FALSE(adapter.prunes_at({18001, 30000}, false));
  EXPECT_FALSE(adapter.prunes_at({30000, 30000}, false)) << "nothing is left to recover in";
  EXPECT_FALSE(adapter.prunes_at({30000, 30001}, false)) << "one iteration is not enough either";
  EXPECT_FALSE(adapter.prunes_at({7000, 7004}, false));
  EXPECT_TRUE(adapter.prunes_at({27000, 30001}, false));
  EXPECT_TRUE(adapter.prunes_at({4200, 7000}, false)) << "the plan scales with the run";
  const Hand hand{{0, 0, 0, 0}, {}, {0.09f, 0.11f, 0.5f, 0.5f}, {1, 1, 1, 1}};
  FakeRasterizer rasterizer({0, 10, 95, 100});
  std::vector<std::uint8_t> remove(4);
  PruneDecisions prune{remove, PruneRule::late, {}};
  adapter.prune(hand.at(18000), rasterizer, prune);
  EXPECT_EQ(remove, (std::vector<std::uint8_t>{1, 0, 1, 1}));
}

TEST_F(VanillaAdapterTest, removes_what_is_near_a_camera) {
  const auto removed = [&](const VanillaBoost& boost, PruneRule rule, std::vector<float> clearances) {
    VanillaAdapter adapter(boost, threads_);
    Hand hand{{0, 0, 0}, {}, {0.5f, 0.5f, 0.5f}, {1, 1, 1}};
    hand.clearances = std::move(clearances);
    FakeRasterizer rasterizer({0, 0, 0});
    std::vector<std::uint8_t> remove(3), clone(3), split(3);
    std::vector<std::uint32_t> origins{0, 1, 2};
    GrowDecisions grow{clone, split};
    if (rule == PruneRule::growth && boost.vcp) adapter.grow(hand.at(18000), rasterizer, grow);
    PruneDecisions prune{remove, rule, origins};
    adapter.prune(hand.at(18000), rasterizer, prune);
    return remove;
  };
  using Mask = std::vector<std::uint8_t>;
  VanillaBoost boost = boost_at_paper_size();
  boost.absgrad = false;
  EXPECT_TRUE(VanillaAdapter(boost, threads_).needs_clearances());
  for (const PruneRule rule : {PruneRule::growth, PruneRule::late}) {
    EXPECT_EQ(removed(boost, rule, {0.79f, 0.8f, 3}), (Mask{1, 0, 0}));
    EXPECT_EQ(removed(boost, rule, {}), (Mask{0, 0, 0})) << "not known";
    EXPECT_THROW(removed(boost, rule, {3, 3, 3, 3}), ArgumentError);
  }
  boost.vcp = false;
  EXPECT_EQ(removed(boost, PruneRule::growth, {0.79f, 0.8f, 3}), (Mask{1, 0, 0})) << "a part of its own";
  boost.min_clearance = 0;
  EXPECT_EQ(removed(boost, PruneRule::growth, {0, 0.8f, 3}), (Mask{0, 0, 0}));
  EXPECT_FALSE(VanillaAdapter(literal_boost(), threads_).needs_clearances());
  boost.min_clearance = -1;
  EXPECT_THROW(check(boost), ArgumentError);
}

TEST_F(VanillaAdapterTest, large_gaussians_are_not_pruned) {
  VanillaBoost boost;
  const auto prunes = [&](bool backbone_would) {
    return VanillaAdapter(boost, threads_).prunes_large_at({5000, 30000}, backbone_would);
  };
  EXPECT_FALSE(prunes(true));
  boost.prune_large = true;
  EXPECT_TRUE(prunes(true));
  EXPECT_FALSE(prunes(false)) << "when is the backbone's to say";
  boost.prune_large = boost.vcp = false;
  EXPECT_TRUE(prunes(true)) << "pruning is the backbone's";
}

TEST_F(VanillaAdapterTest, absolute_scores_do_not_depend_on_other_primitives) {
  const auto removed = [&](const std::vector<std::int32_t>& counts, bool absolute) {  // of 32 flagged pixels
    VanillaBoost boost = boost_at_paper_size();
    boost.absolute_scores = absolute;
    VanillaAdapter adapter(boost, threads_);
    const Hand hand{{0, 0, 0}, {}, {0.5f, 0.5f, 0.5f}, {1, 1, 1}};
    FakeRasterizer rasterizer(counts);
    std::vector<std::uint8_t> remove(3);
    PruneDecisions prune{remove, PruneRule::late, {}};
    adapter.prune(hand.at(18000), rasterizer, prune);
    return remove;
  };
  using Mask = std::vector<std::uint8_t>;
  EXPECT_EQ(removed({4, 10, 20}, false), (Mask{0, 0, 1}));
  EXPECT_EQ(removed({4, 10, 20}, true), (Mask{0, 0, 0})) << "the worst of a block is not removed for that alone";
  EXPECT_EQ(removed({30, 10, 20}, true), (Mask{1, 0, 0})) << "in 30 of 32";
}

TEST_F(VanillaAdapterTest, growth_may_begin_at_any_iteration) {
  for (const int from : {1000000, std::numeric_limits<int>::max()}) {  // never
    VanillaBoost boost;
    boost.densify_from = from;
    const VanillaAdapter adapter(boost, threads_);
    EXPECT_FALSE(adapter.grows_at({5000, 30000}, true)) << from;
    EXPECT_FALSE(adapter.prunes_at({7500, 30000}, false)) << from;
    EXPECT_TRUE(adapter.prunes_at({15000, 30000}, false)) << from;
  }
}

TEST_F(VanillaAdapterTest, late_pruning_is_milder_where_views_are_seen_few_times) {
  // 30 000 iterations are 50 per view for 600 views and 5 for 6 000, where the threshold is a hundredth.
  const Hand hand{{0, 0, 0, 0}, {}, {0.099f, 0.101f, 0.00099f, 0.00101f}, {}};
  const auto removed = [&](std::size_t views, bool literal) {
    VanillaBoost boost = boost_at_paper_size();
    boost.literal = literal;
    VanillaAdapter adapter(boost, threads_);
    FakeRasterizer rasterizer({1, 1, 1, 1}, views);
    std::vector<std::uint8_t> remove(4, 0);
    PruneDecisions prune{remove, PruneRule::late, {}};
    adapter.prune(hand.at(18000), rasterizer, prune);
    return remove;
  };
  using Mask = std::vector<std::uint8_t>;
  EXPECT_EQ(removed(10, false), (Mask{1, 0, 1, 1}));
  EXPECT_EQ(removed(600, false), (Mask{1, 0, 1, 1}));
  EXPECT_EQ(removed(6000, false), (Mask{0, 0, 1, 0}));
  EXPECT_EQ(removed(6000, true), (Mask{1, 0, 1, 1})) << "the paper's threshold is the same everywhere";
}

TEST_F(VanillaAdapterTest, what_shows_least_goes_when_growth_has_ended) {
  const Hand hand{{0, 0, 0, 0, 0}, {}, {0.5f, 0.5f, 0.5f, 0.5f, 0.05f}, {}};
  const auto removed = [&](int iteration, std::size_t views, double share) {
    VanillaBoost boost = boost_at_paper_size();
    boost.late_share = share;
    VanillaAdapter adapter(boost, threads_);
    FakeRasterizer rasterizer({1, 1, 1, 1, 1}, views);
    rasterizer.weights = {60, 10, 0, 20, 10};
    std::vector<std::uint8_t> remove(5, 0);
    PruneDecisions prune{remove, PruneRule::late, {}};
    adapter.prune(hand.at(iteration), rasterizer, prune);
    return remove;
  };
  using Mask = std::vector<std::uint8_t>;
  EXPECT_EQ(removed(7500, 10, 0.1), (Mask{0, 1, 0, 0, 1})) << "a tenth of 100; the last is faint";
  EXPECT_EQ(removed(7500, 10, 0.3), (Mask{0, 1, 0, 1, 1}));
  EXPECT_EQ(removed(18000, 10, 0.3), (Mask{0, 0, 0, 0, 1})) << "once";
  EXPECT_EQ(removed(7500, 10, 0), (Mask{0, 0, 0, 0, 1}));
  EXPECT_EQ(removed(7500, 1200, 0.4), (Mask{0, 1, 0, 0, 0}))
      << "views seen 25 times: a quarter of the share and of the opacity";
}

TEST_F(VanillaAdapterTest, what_shows_least_stays_in_photos_with_a_background_after_random_points) {
  const Hand hand{{0, 0, 0, 0}, {}, {0.5f, 0.5f, 0.5f, 0.05f}, {}};
  const auto removed = [&](bool random, bool background, double share_random) {
    VanillaBoost boost = boost_at_paper_size();
    boost.late_share = 0.1;
    boost.late_share_random = share_random;
    boost.random_points = random;
    VanillaAdapter adapter(boost, threads_);
    FakeRasterizer rasterizer({1, 1, 1, 1});
    rasterizer.weights = {70, 10, 20, 0};
    // The right half of each view is rendered exactly; without it the scene covers all valid pixels.
    for (int p = 0; background && p < 64; ++p) rasterizer.valid.push_back(p % 8 < 4);
    std::vector<std::uint8_t> remove(4, 0);
    PruneDecisions prune{remove, PruneRule::late, {}};
    adapter.prune(hand.at(7500), rasterizer, prune);
    return remove;
  };
  using Mask = std::vector<std::uint8_t>;
  EXPECT_EQ(removed(true, true, 0), (Mask{0, 0, 0, 1}));
  EXPECT_EQ(removed(true, true, 0.3), (Mask{0, 1, 1, 1}));
  EXPECT_EQ(removed(true, false, 0), (Mask{0, 1, 0, 1})) << "an object in front of nothing";
  EXPECT_EQ(removed(false, true, 0), (Mask{0, 1, 0, 1})) << "points on surfaces";
}

// Six Gaussians of which the first two grow; the caps below leave room for both, for one or for none.
class VanillaCapTest : public VanillaAdapterTest {
 protected:
  using Mask = std::vector<std::uint8_t>;

  /// @return what is removed at a growth, of the six and of copies of the first two
  Mask removed_at_growth(const VanillaBoost& boost, int iteration, std::size_t cap) {
    VanillaAdapter adapter(boost, threads_);
    FakeRasterizer rasterizer({99, 99, 99, 99, 99, 99}, 60);
    rasterizer.weights = {400, 500, 0, 3, 94, 3};
    DensityStatistics statistics = hand_.at(iteration);
    statistics.max_primitives = cap;
    Mask clone(6), split(6), remove(8, 0);
    std::vector<float> priorities(6);
    GrowDecisions grow{clone, split, priorities};
    adapter.grow(statistics, rasterizer, grow);
    EXPECT_EQ(clone, (Mask{1, 1, 0, 0, 0, 0}));
    const std::vector<std::uint32_t> origins{0, 1, 2, 3, 4, 5, 0, 1};
    PruneDecisions prune{remove, PruneRule::growth, origins};
    adapter.prune(hand_.at(iteration), rasterizer, prune);
    return remove;
  }

  Hand hand_{{1, 1, 0, 0, 0, 0}, {0, 0, 0, 0, 0, 0}, {0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.05f}, {0, 0, 0, 0, 0, 0}};
};

TEST_F(VanillaCapTest, growth_that_reaches_a_cap_makes_room_for_the_next) {
  const VanillaBoost boost = boost_at_paper_size();
  const Mask none(8, 0), least{0, 0, 0, 1, 0, 1, 0, 0};  // the third shows in no view: nothing is known about it
  EXPECT_EQ(removed_at_growth(boost, 1000, 8), least);
  EXPECT_EQ(removed_at_growth(boost, 1000, 6), least);
  EXPECT_EQ(removed_at_growth(boost, 1000, 9), none) << "less than nine tenths of the cap";
  EXPECT_EQ(removed_at_growth(boost, 1000, 0), none) << "no cap";
  EXPECT_EQ(removed_at_growth(boost, 7300, 8), least);
  EXPECT_EQ(removed_at_growth(boost, 7400, 8), none) << "no growth follows";
  VanillaBoost off = boost;
  off.replaced_share = 0;
  EXPECT_EQ(removed_at_growth(off, 1000, 8), none);
  off = boost;
  off.vcp = false;
  EXPECT_EQ(removed_at_growth(off, 1000, 8), none);
  EXPECT_EQ(literal_boost().replaced_share, 0);
}

TEST_F(VanillaCapTest, late_pruning_leaves_what_a_cap_leaves) {
  const auto removed = [&](int iteration, std::size_t cap, double share, bool vcd = true) {
    VanillaBoost boost = boost_at_paper_size();
    boost.replaced_share = share;
    boost.vcd = vcd;
    VanillaAdapter adapter(boost, threads_);
    FakeRasterizer rasterizer({1, 1, 1, 1, 1, 1}, 60);
    rasterizer.weights = {400, 500, 0, 3, 94, 3};
    DensityStatistics statistics = hand_.at(iteration);
    statistics.max_primitives = cap;
    Mask remove(6, 0);
    PruneDecisions prune{remove, PruneRule::late, {}};
    adapter.prune(statistics, rasterizer, prune);
    return remove;
  };
  const Mask none(6, 0);
  EXPECT_EQ(removed(7500, 6, 0.01), none);
  EXPECT_EQ(removed(18000, 6, 0.01), none);
  EXPECT_EQ(removed(7500, 7, 0.01), (Mask{0, 0, 0, 1, 0, 1})) << "growth did not reach this cap";
  EXPECT_EQ(removed(18000, 7, 0.01), (Mask{0, 0, 0, 0, 0, 1}));
  EXPECT_EQ(removed(7500, 5, 0.01), (Mask{0, 0, 0, 1, 0, 1})) << "a host began with more than the cap";
  EXPECT_EQ(removed(7500, 6, 0), (Mask{0, 0, 0, 1, 0, 1}));
  EXPECT_EQ(removed(18000, 6, 0.01, false), (Mask{0, 0, 0, 0, 0, 1})) << "growth of the backbone makes no room";
}

TEST_F(VanillaAdapterTest, removal_that_is_not_the_papers_passes_untouched) {
  const Hand hand{{0, 0, 0, 0}, {0, 0, 0, 0}, {0.09f, 0.11f, 0.5f, 0.5f}, {1, 1, 1, 1}};
  const std::vector<std::uint8_t> candidates{0, 1, 0, 0};
  const auto pruned = [&](PruneRule rule, int iteration, bool after_growth) {
    VanillaAdapter adapter(boost_at_paper_size(), threads_);
    FakeRasterizer rasterizer({0, 10, 95, 100});
    std::vector<std::uint8_t> clone(4), split(4), remove = candidates;
    GrowDecisions grow{clone, split};
    if (after_growth) adapter.grow(hand.at(iteration), rasterizer, grow);
    rasterizer.rendered.clear();
    PruneDecisions prune{remove, rule, {}};
    adapter.prune(hand.at(iteration), rasterizer, prune);
    EXPECT_EQ(rasterizer.rendered.empty(), remove == candidates) << "views are scored where scores decide";
    return remove;
  };
  for (const bool after_growth : {false, true}) {
    EXPECT_EQ(pruned(PruneRule::trim, 1000, after_growth), candidates);
    EXPECT_EQ(pruned(PruneRule::trim, 18000, after_growth), candidates) << "not even at a moment of late pruning";
    EXPECT_EQ(pruned(PruneRule::late, 17000, after_growth), candidates) << "late is said by the moment";
    EXPECT_EQ(pruned(PruneRule::late, 18000, after_growth), (std::vector<std::uint8_t>{1, 1, 1, 1}))
        << "the late rule adds to the backbone's candidates";
  }
}

TEST_F(VanillaAdapterTest, fewer_views_than_k_score_each_once) {
  VanillaBoost boost = boost_at_paper_size();
  VanillaAdapter adapter(boost, threads_);
  const Hand hand{{0}, {0}, {0.5f}, {1}};
  FakeRasterizer rasterizer({1}, 3);
  std::vector<std::uint8_t> remove(1);
  PruneDecisions prune{remove, PruneRule::late, {}};
  adapter.prune(hand.at(18000), rasterizer, prune);
  std::sort(rasterizer.rendered.begin(), rasterizer.rendered.end());
  EXPECT_EQ(rasterizer.rendered, (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_EQ(rasterizer.flagged_pixels, 32u);
}

TEST_F(VanillaAdapterTest, grows_as_often_as_3dgs) {
  VanillaBoost boost = boost_at_paper_size();
  const auto growths = [&](int total) {
    const VanillaAdapter adapter(boost, threads_);
    std::vector<int> at;
    for (int i = 1; i <= total; ++i) {
      if (adapter.grows_at({i, total}, false)) at.push_back(i);
    }
    return at;
  };
  const std::vector<int> published = growths(30000);
  EXPECT_EQ(published.size(), 69u);
  EXPECT_EQ(published.front(), 600);
  EXPECT_EQ(published.back(), 7400);
  EXPECT_EQ(growths(7000).size(), 16u) << "200, 300 … 1700: intervals do not scale";
  EXPECT_EQ(growths(3000).size(), 12u) << "100, 200 … 1200: growth ends after a quarter of the run for that";
  boost.densify_until = 1000;
  EXPECT_EQ(growths(30000), (std::vector<int>{600, 700, 800, 900})) << "as was asked for";
  boost.densify_until = 0;
  EXPECT_EQ(growths(30000), std::vector<int>{});
  boost.densify_until = 10000;
  boost.densify_interval = 500;  // the paper's
  EXPECT_EQ(growths(30000).size(), 18u);
  EXPECT_EQ(growths(1200), (std::vector<int>{100, 200, 300, 400, 500}))
      << "never more often than 3DGS itself, nor in the second half";
  EXPECT_EQ(growths(2400), (std::vector<int>{100, 200, 300, 400, 500, 600, 700, 800, 900, 1000, 1100}));
  boost.vcd = false;
  EXPECT_TRUE(VanillaAdapter(boost, threads_).grows_at({7, 2000}, true)) << "without VCD the backbone decides";
}

TEST_F(VanillaAdapterTest, needs_the_statistics_and_decisions_of_all_primitives) {
  const auto grow = [&](const VanillaBoost& boost, const Hand& hand, std::size_t splits) {
    VanillaAdapter adapter(boost, threads_);
    std::vector<std::uint8_t> clone(3), split(splits);
    GrowDecisions decisions{clone, split};
    FakeRasterizer rasterizer({0, 0, 0});
    adapter.grow(hand.at(1000), rasterizer, decisions);
  };
  VanillaBoost boost = boost_at_paper_size();
  const std::vector<float> three(3, 1.0f);
  EXPECT_NO_THROW(grow(boost, {three, three, {}, three}, 3));
  EXPECT_THROW(grow(boost, {three, three, {}, three}, 0), ArgumentError) << "a backbone that cannot split";
  EXPECT_THROW(grow(boost, {three, {}, {}, three}, 3), ArgumentError);
  EXPECT_THROW(grow(boost, {three, three, {}, {}}, 3), ArgumentError);
  EXPECT_THROW(grow(boost, {{}, three, {}, three}, 3), ArgumentError);
  boost.absgrad = false;
  EXPECT_NO_THROW(grow(boost, {{}, {}, {}, {}}, 3));
}

TEST_F(VanillaAdapterTest, late_scores_do_not_prune_within_growth) {
  VanillaAdapter adapter(boost_at_paper_size(), threads_);
  const std::vector<float> six(6, 1.0f);
  const Hand hand{six, six, six, six}, fewer{{0, 0}, {}, {0.5f, 0.5f}, {1, 1}};
  std::vector<std::uint8_t> clone(6), split(6), remove(6, 1), late(2);
  const std::vector<std::uint32_t> origins{0, 1, 2, 3, 4, 5};
  GrowDecisions grow{clone, split};
  PruneDecisions within{remove, PruneRule::growth, origins}, without{remove, PruneRule::growth, {}};
  FakeRasterizer rasterizer({0, 1, 2, 3, 4, 5}), of_fewer({0, 1});
  adapter.grow(hand.at(18000), rasterizer, grow);
  EXPECT_THROW(adapter.prune(hand.at(18000), rasterizer, without), ArgumentError);
  EXPECT_NO_THROW(adapter.prune(hand.at(18000), rasterizer, within));
  PruneDecisions last{late, PruneRule::late, {}};
  adapter.prune(fewer.at(18000), of_fewer, last);
  EXPECT_THROW(adapter.prune(hand.at(18000), rasterizer, within), ArgumentError) << "those are of two primitives";
}

TEST_F(VanillaAdapterTest, the_longest_run_has_a_plan) {
  constexpr int kMost = std::numeric_limits<int>::max();
  const VanillaAdapter adapter(boost_at_paper_size(), threads_);
  EXPECT_FALSE(adapter.prunes_at({kMost - 7, kMost}, false));
  EXPECT_FALSE(adapter.prunes_at({kMost, kMost}, false));
  EXPECT_FALSE(adapter.grows_at({kMost - 7, kMost}, false));
}

TEST_F(VanillaAdapterTest, schedule_follows_the_paper) {
  VanillaAdapter adapter(boost_at_paper_size(), threads_);
  int rest = 0, others = 0;
  for (int i = 1; i <= 30000; ++i) {
    rest += adapter.steps_at("f_rest", {i, 30000});
    others += adapter.steps_at("xyz", {i, 30000});
  }
  // 15 000 + 5 000/32 + 10 000/64 steps, for f_rest 15 000/16 in place of 15 000; the last iteration steps as well.
  EXPECT_EQ(others, 15000 + 157 + 156 + 1);
  EXPECT_EQ(rest, 937 + 157 + 156 + 1);
}

TEST_F(VanillaAdapterTest, higher_bands_step_every_fourth_iteration_of_a_short_run) {
  const auto steps_of = [&](const VanillaBoost& boost, std::string_view group) {
    const VanillaAdapter adapter(boost, threads_);
    int steps = 0;
    for (int i = 1; i <= 3001; ++i) steps += adapter.steps_at(group, {i, 3001});
    return steps;
  };
  EXPECT_EQ(steps_of({}, "f_rest"), 750 + 1) << "the last iteration steps as well";
  EXPECT_EQ(steps_of({}, "f_dc"), 3001);
  EXPECT_EQ(steps_of({.rest_interval = 1}, "f_rest"), 3001);
  EXPECT_EQ(steps_of({.schedule = false}, "f_rest"), 3001);
}

TEST_F(VanillaAdapterTest, higher_bands_have_the_release_s_rate_where_the_schedule_applies) {
  const auto factor = [&](const VanillaBoost& boost, std::string_view group) {
    return VanillaAdapter(boost, threads_).rate_factor(group, {100, 7000});
  };
  EXPECT_EQ(factor({}, "f_rest"), 2);
  EXPECT_EQ(factor({}, "f_dc"), 1);
  EXPECT_EQ(factor({.schedule = false}, "f_rest"), 1);
  EXPECT_EQ(factor(literal_boost(), "f_rest"), 1);
}

TEST_F(VanillaAdapterTest, means_follow_the_distance_to_the_scene_where_cameras_are_close_together) {
  const auto factor = [&](VanillaBoost boost, double ratio) {
    boost.depth_ratio = ratio;
    return VanillaAdapter(boost, threads_).rate_factor("xyz", {100, 7000});
  };
  EXPECT_EQ(factor({}, 0), 1) << "not known";
  EXPECT_EQ(factor({}, 0.6), 1) << "the cameras are all around";
  EXPECT_EQ(factor({}, 1.25), 1);
  EXPECT_EQ(factor({}, 5), 4);
  EXPECT_EQ(factor({.schedule = false}, 5), 4) << "a rule of its own";
  EXPECT_EQ(factor({.rate_by_depth = false}, 5), 1);
  EXPECT_EQ(factor(literal_boost(), 5), 1);
  EXPECT_THROW(factor({}, -1), ArgumentError);
}

TEST_F(VanillaAdapterTest, higher_bands_have_a_higher_rate_where_views_are_used_seldom) {
  const auto factor = [&](VanillaBoost boost, int views) {
    boost.training_views = views;
    return VanillaAdapter(boost, threads_).rate_factor("f_rest", {100, 7000});
  };
  EXPECT_EQ(factor({}, 255), 4) << "27 uses";
  EXPECT_EQ(factor({}, 140), 4) << "50 uses";
  EXPECT_FLOAT_EQ(factor({}, 100), 200.0f / 70) << "70 uses";
  EXPECT_EQ(factor({}, 70), 2) << "100 uses";
  EXPECT_EQ(factor({}, 1), 2);
  EXPECT_EQ(factor({.rest_rate = 6}, 255), 6) << "never below rest_rate";
  EXPECT_EQ(factor({.rest_rate = 1, .rest_rate_few = 1}, 255), 1);
  EXPECT_EQ(factor({.schedule = false}, 255), 1);
  EXPECT_EQ(factor(literal_boost(), 255), 1);
}

}  // namespace
}  // namespace splatboost

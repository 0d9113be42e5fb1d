// SPDX-License-Identifier: Apache-2.0
// The baseline is the published one: every decision of a run is recorded and compared with a direct implementation of
// the rules of adaptive density control (Kerbl et al. 2023, Sec. 5, with the constants of the 2023 release).
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "support/density_recorder.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "trainer/support/input_error.h"
#include "vanilla/vanilla.h"

namespace splatboost {
namespace {

using Event = testing::DensityEvent;
using Recorder = testing::DensityRecorder;

class AdcTrace : public ::testing::Test {
 protected:
  static constexpr int kIterations = 600;  // 1/50 of the published run

  void run(VanillaConfig config, std::size_t cap = 0) {
    backbone_ = make_vanilla({scene_, threads_, 3, kIterations, cap}, config);
    backbone_->set_hooks(&recorder_, nullptr);
    sizes_.push_back(backbone_->primitives());
    for (int i = 1; i <= kIterations; ++i) {
      backbone_->train_step(i, scene_.train[static_cast<std::size_t>(i) % scene_.train.size()]);
      sizes_.push_back(backbone_->primitives());
    }
  }

  Threads threads_{2};
  Scene scene_ = testing::tiny_scene(threads_);
  Recorder recorder_;
  std::unique_ptr<Backbone> backbone_;
  std::vector<std::size_t> sizes_;  ///< after each iteration; [0] at the start
};

VanillaConfig eager() {
  VanillaConfig config;
  config.densify_interval = 10;
  config.opacity_reset_interval = 3000;  // at 1/50: every 60 iterations
  return config;
}

TEST_F(AdcTrace, grows_and_prunes_when_and_only_when_the_published_plan_says) {
  run(eager());
  std::set<int> expected;
  for (int i = 1; i <= kIterations; ++i) {
    if (i < 300 && i > 10 && i % 10 == 0) expected.insert(i);
  }
  std::set<int> growths, prunes;
  for (const Event& e : recorder_.events) (e.growth ? growths : prunes).insert(e.iteration);
  EXPECT_EQ(growths, expected);
  EXPECT_EQ(prunes, expected);
  for (std::size_t i = 301; i < sizes_.size(); ++i) EXPECT_EQ(sizes_[i], sizes_[300]);
}

TEST_F(AdcTrace, clones_small_and_splits_large_ones_that_move) {
  run(eager());
  const double border = 0.01 * static_cast<double>(scene_.extent);
  std::size_t clones = 0, splits = 0;
  for (const Event& e : recorder_.events) {
    if (!e.growth) continue;
    for (std::size_t i = 0; i < e.clone.size(); ++i) {
      const bool moves = e.gradients[i] >= 2e-4f;
      const bool small = static_cast<double>(e.max_scales[i]) <= border;
      EXPECT_EQ(e.clone[i] != 0, moves && small) << "iteration " << e.iteration << " Gaussian " << i;
      EXPECT_EQ(e.split[i] != 0, moves && !small) << "iteration " << e.iteration << " Gaussian " << i;
      clones += e.clone[i];
      splits += e.split[i];
    }
  }
  EXPECT_GT(splits, 10u) << "the scene must exercise the rule";
}

TEST_F(AdcTrace, growth_changes_the_count_by_one_a_decision_and_pruning_by_the_rule) {
  run(eager());
  for (std::size_t k = 0; k + 1 < recorder_.events.size(); k += 2) {
    const Event& grow = recorder_.events[k];
    const Event& prune = recorder_.events[k + 1];
    ASSERT_TRUE(grow.growth && !prune.growth && grow.iteration == prune.iteration);
    const auto added = static_cast<std::size_t>(std::count(grow.clone.begin(), grow.clone.end(), 1) +
                                                std::count(grow.split.begin(), grow.split.end(), 1));
    EXPECT_EQ(prune.remove.size(), grow.clone.size() + added);
    std::size_t removed = 0;
    for (std::size_t i = 0; i < prune.remove.size(); ++i) {
      const bool large_go = grow.iteration > 60;
      const bool large = static_cast<double>(prune.max_scales[i]) > 0.1 * static_cast<double>(scene_.extent);
      EXPECT_EQ(prune.remove[i] != 0, prune.opacities[i] < 0.005f || (large_go && large));
      removed += prune.remove[i];
      // The parent of each clone and each child of a split was selected by the growth.
      ASSERT_LT(prune.origins[i], grow.clone.size());
      if (i >= grow.clone.size()) {
        const std::uint32_t parent = prune.origins[i];
        EXPECT_TRUE(grow.clone[parent] != 0 || grow.split[parent] != 0);
      }
    }
    EXPECT_EQ(sizes_[static_cast<std::size_t>(grow.iteration)], prune.remove.size() - removed);
  }
}

TEST_F(AdcTrace, large_gaussians_stay_if_the_hook_says_so) {
  class Sparing : public Recorder {
   public:
    bool prunes_large_at(Moment moment, bool backbone_would) const override {
      EXPECT_EQ(backbone_would, moment.iteration > 60);
      return false;
    }
  } sparing;
  VanillaConfig config = eager();
  config.max_world_scale = 0.01;
  backbone_ = make_vanilla({scene_, threads_, 3, kIterations, 0}, config);
  backbone_->set_hooks(&sparing, nullptr);
  for (int i = 1; i <= 100; ++i) {
    backbone_->train_step(i, scene_.train[static_cast<std::size_t>(i) % scene_.train.size()]);
  }
  std::size_t spared = 0;
  for (const Event& e : sparing.events) {
    for (std::size_t i = 0; i < e.remove.size(); ++i) {
      EXPECT_EQ(e.remove[i] != 0, e.opacities[i] < 0.005f) << e.iteration;
      const bool large = static_cast<double>(e.max_scales[i]) > 0.01 * static_cast<double>(scene_.extent);
      if (e.iteration > 60 && e.remove[i] == 0 && large) ++spared;
    }
  }
  EXPECT_GT(spared, 0u) << "the scene must exercise the rule";
}

TEST_F(AdcTrace, opacities_are_reset_on_schedule) {
  run(eager());
  // The events right after a reset (at 60, 120, …, 240) see no opacity far above the reset value; those before it do.
  float before = 0, after = 0;
  for (const Event& e : recorder_.events) {
    if (!e.growth) continue;
    const float highest = *std::max_element(e.opacities.begin(), e.opacities.end());
    if (e.iteration == 60) before = highest;
    if (e.iteration == 70) after = highest;
  }
  EXPECT_GT(before, 0.1f);
  EXPECT_LT(after, 0.05f);
}

TEST_F(AdcTrace, the_cap_is_never_exceeded) {
  run(eager(), 55);
  for (const std::size_t n : sizes_) EXPECT_LE(n, 55u);
  EXPECT_EQ(*std::max_element(sizes_.begin(), sizes_.end()), 55u) << "the cap must have been reached to be tested";
}

TEST_F(AdcTrace, a_cap_below_the_initial_points_keeps_a_subset) {
  run(eager(), 17);
  EXPECT_EQ(sizes_[0], 17u);
  for (const std::size_t n : sizes_) EXPECT_LE(n, 17u);
  const SplatCloud begun = testing::exported(*make_vanilla({scene_, threads_, 3, kIterations, 17}, eager()));
  ASSERT_EQ(begun.size(), 17u);
  std::set<std::size_t> kept;
  for (std::size_t i = 0; i < begun.size(); ++i) {
    for (std::size_t p = 0; p < scene_.points.size(); ++p) {
      if (std::equal(&begun.means[3 * i], &begun.means[3 * i] + 3, &scene_.points.positions[3 * p])) kept.insert(p);
    }
  }
  EXPECT_EQ(kept.size(), 17u) << "each is at a point of its own";
  std::size_t next = 0;
  for (const std::size_t p : kept) {
    EXPECT_LE(p, next + 2) << "an even subset of 40 points leaves out at most two in a row";
    next = p + 1;
  }
  EXPECT_GE(next, scene_.points.size() - 2);
}

/// Selects everything for removal.
class RemoveAll : public Recorder {
 public:
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions& d) override {
    std::fill(d.remove.begin(), d.remove.end(), std::uint8_t{1});
  }
};

TEST_F(AdcTrace, a_pass_never_removes_all) {
  RemoveAll all;
  backbone_ = make_vanilla({scene_, threads_, 3, kIterations, 0}, eager());
  backbone_->set_hooks(&all, nullptr);
  for (int i = 1; i <= 40; ++i) backbone_->train_step(i, scene_.train[0]);
  EXPECT_EQ(backbone_->primitives(), 1u);
}

TEST(VanillaTraining, reaches_a_stated_quality_on_a_tiny_scene) {
  Threads threads(2);
  const Scene scene = testing::tiny_scene(threads);
  const auto backbone = make_vanilla({scene, threads, 0, 400, 0}, {});
  double first = 0, last = 0;
  for (int i = 1; i <= 400; ++i) {
    const double loss = backbone->train_step(i, scene.train[static_cast<std::size_t>(i) % scene.train.size()]);
    if (i <= 10) first += loss / 10;
    if (i > 390) last += loss / 10;
  }
  EXPECT_LT(last, 0.35 * first);
}

TEST(VanillaTraining, the_release_of_2024_scores_and_trains_on_clamped_images) {
  Threads threads(2);
  Scene scene = testing::tiny_scene(threads);
  std::ranges::fill(scene.train[0].color, std::uint8_t{255});  // training can only make the image brighter
  const auto brightest = [&](const char* release) {
    VanillaConfig config =
        vanilla_config_from_json({{"release", release}, {"feature_rate", 20}, {"initial_opacity", 0.9}});
    const auto backbone = make_vanilla({scene, threads, 0, 10000, 0}, config);
    backbone->train_step(1, scene.train[0]);
    const ScoredView scored = backbone->rasterizer_hook().render_for_score(0);
    return *std::max_element(scored.color.begin(), scored.color.end());
  };
  EXPECT_GT(brightest("2023"), 1) << "the step must be large enough to overshoot";
  EXPECT_EQ(brightest("2024"), 1);
}

TEST(VanillaConfig, settings_that_no_run_can_have_are_refused) {
  for (const char* name : {"feature_rate", "opacity_rate", "scaling_rate", "rotation_rate", "gradient_threshold",
                           "percent_dense", "max_world_scale", "min_opacity"}) {
    EXPECT_THROW(vanilla_config_from_json({{name, -0.1}}), InputError) << name;
    EXPECT_NO_THROW(vanilla_config_from_json({{name, 0}})) << name;
  }
  EXPECT_THROW(vanilla_config_from_json({{"min_opacity", 1}}), InputError);
  EXPECT_THROW(vanilla_config_from_json({{"densify_interval", 2147483647}}), InputError);
}

TEST(VanillaConfig, a_release_sets_defaults_that_single_values_override) {
  EXPECT_EQ(vanilla_config_from_json(nlohmann::json::object()).opacity_rate, 0.05);
  EXPECT_EQ(vanilla_config_from_json({{"release", "2024"}}).opacity_rate, 0.025);
  EXPECT_EQ(vanilla_config_from_json({{"release", "2024"}, {"opacity_rate", 0.1}}).opacity_rate, 0.1);
  EXPECT_THROW(vanilla_config_from_json({{"release", "2022"}}), InputError);
}

TEST(VanillaTraining, accumulated_gradients_are_applied_at_the_end) {
  Threads threads(1);
  const Scene scene = testing::tiny_scene(threads);
  const auto backbone = make_vanilla({scene, threads, 0, 10000, 0}, {});
  testing::StepsEveryThird hook;
  backbone->set_hooks(nullptr, &hook);
  std::vector<float> before(scene.train[0].color.size()), after(before.size());
  for (int i = 1; i <= 4; ++i) backbone->train_step(i, scene.train[0]);
  backbone->render(scene.train[0].camera, 0, std::nullopt, before);
  backbone->finish();
  backbone->render(scene.train[0].camera, 0, std::nullopt, after);
  EXPECT_NE(before, after) << "the gradient of iteration 4 must not be lost";
}

}  // namespace
}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
// Training DropGaussian: dropout, loss and gradients, unbiased statistics, published decisions, resume, quality.
#include "dropgaussian/dropgaussian.h"

#include <gtest/gtest.h>

#include "splatboost/activations.h"
#include "trainer/evaluation/evaluate.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "support/density_recorder.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "trainer/training/trainer.h"

namespace splatboost {
namespace {

using testing::DensityEvent;
using testing::DensityRecorder;
using testing::exported;
using testing::view_at;

std::vector<float> dropout(std::uint64_t seed, int iteration, double rate, std::size_t n, int threads_count = 2) {
  Threads threads(threads_count);
  std::vector<float> factors(n);
  draw_dropout(seed, iteration, rate, factors, threads);
  return factors;
}

TEST(Dropout, drops_the_share_it_is_told_and_makes_up_for_it) {
  constexpr std::size_t kCount = 200000;
  for (const double rate : {0.0, 0.05, 0.2}) {
    const std::vector<float> factors = dropout(1, 7, rate, kCount);
    const auto dropped = static_cast<double>(std::count(factors.begin(), factors.end(), 0.0f));
    EXPECT_NEAR(dropped / kCount, rate, 4 * std::sqrt(rate * (1 - rate) / kCount));
    for (const float factor : factors) ASSERT_TRUE(factor == 0 || factor == static_cast<float>(1 / (1 - rate)));
    EXPECT_NEAR(std::accumulate(factors.begin(), factors.end(), 0.0) / kCount, 1, 0.01);
  }
}

TEST(Dropout, is_a_function_of_seed_and_iteration_alone) {
  const std::vector<float> factors = dropout(1, 7, 0.2, 30000);
  EXPECT_EQ(factors, dropout(1, 7, 0.2, 30000, 1));
  EXPECT_NE(factors, dropout(2, 7, 0.2, 30000));
  EXPECT_NE(factors, dropout(1, 8, 0.2, 30000));
}

class DropGaussianRun : public ::testing::Test {
 protected:
  static constexpr int kIterations = 200;  // 1/50 of the published run

  static DropGaussianConfig eager() {
    DropGaussianConfig config;
    config.densify_interval = 10;
    return config;
  }
  std::unique_ptr<Backbone> make(const DropGaussianConfig& config, int iterations = kIterations, std::size_t cap = 0) {
    return make_dropgaussian({scene_, threads_, 3, iterations, cap}, config);
  }

  Threads threads_{2};
  Scene scene_ = testing::tiny_scene(threads_);
};

TEST_F(DropGaussianRun, gradients_are_those_of_what_was_kept_under_its_own_loss) {
  const auto trained = make({}, 1000);
  for (int i = 1; i <= 50; ++i) trained->train_step(i, view_at(scene_, i));
  const SplatCloud cloud = exported(*trained);
  const View& view = scene_.train[1];
  // Iteration 19 of 20: nearly the full rate, before a degree of spherical harmonics becomes active.
  constexpr int kAt = 19, kOf = 20;
  DropGaussianConfig config;
  config.sh_interval = 10000;
  config.densify_from = 10000;
  config.drop_rate = 0.4;
  const auto found = testing::gathered_gradients(*make(config, kOf), cloud, kAt, view);

  const std::vector<float> factors = dropout(3, kAt, 0.4 * kAt / kOf, cloud.size());
  EXPECT_GT(std::count(factors.begin(), factors.end(), 0.0f), 5);
  std::vector<float> scales, opacities;
  for (const float scale : cloud.log_scales) scales.push_back(std::exp(scale));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    opacities.push_back(factors[i] / (1 + std::exp(-cloud.logit_opacities[i])));
  }
  const auto drawn = testing::gradients_of_view(cloud, scales, opacities, view, {}, 1, 0.2f, threads_);
  EXPECT_NEAR(found.loss, drawn.loss, 1e-6 * drawn.loss);
  std::vector<double> expected(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    expected[i] = static_cast<double>(drawn.opacities[i]) * static_cast<double>(factors[i]);
    if (factors[i] == 0) {
      EXPECT_EQ(found.opacities[i], 0.0f);
    }
  }
  testing::expect_close(found.opacities, expected, 1e-4);
  testing::expect_close(found.scales, {drawn.scales.begin(), drawn.scales.end()}, 1e-4);
  testing::expect_close(found.means, {drawn.means.begin(), drawn.means.end()}, 1e-4);
}

TEST_F(DropGaussianRun, images_are_clamped_before_they_are_compared) {
  std::ranges::fill(scene_.train[0].color, std::uint8_t{255});  // training can only make the image brighter
  DropGaussianConfig config;
  config.feature_rate = 20;
  config.initial_opacity = 0.9;
  const auto backbone = make(config, 10000);
  backbone->train_step(1, scene_.train[0]);
  std::vector<float> drawn(scene_.train[0].color.size());
  backbone->render(scene_.train[0].camera, 0, std::nullopt, drawn);
  EXPECT_GT(*std::ranges::max_element(drawn), 1) << "the step must be large enough to overshoot";
  const ScoredView scored = backbone->rasterizer_hook().render_for_score(0);
  EXPECT_EQ(*std::ranges::max_element(scored.color), 1);
}

TEST_F(DropGaussianRun, views_that_are_shown_or_scored_drop_nothing) {
  const auto backbone = make({}, 20);
  testing::train(*backbone, scene_, 1, 20);
  const View& view = scene_.train[0];
  std::vector<float> shown(view.color.size()), again(shown.size());
  backbone->render(view.camera, 0, std::nullopt, shown);
  backbone->render(view.camera, 0, std::nullopt, again);
  EXPECT_EQ(shown, again);
  const ScoredView scored = backbone->rasterizer_hook().render_for_score(0);
  EXPECT_TRUE(std::equal(shown.begin(), shown.end(), scored.color.begin(), scored.color.end()));

  const SplatCloud cloud = exported(*backbone);
  std::vector<float> scales(cloud.log_scales.size()), opacities(cloud.logit_opacities.size());
  exponentials(cloud.log_scales, scales, threads_);
  sigmoids(cloud.logit_opacities, opacities, threads_);
  Gaussians gaussians;
  gaussians.count = cloud.size();
  gaussians.means = cloud.means;
  gaussians.scales = scales;
  gaussians.rotations = cloud.rotations;
  gaussians.opacities = opacities;
  gaussians.sh_dc = cloud.sh_dc;
  gaussians.sh_rest = cloud.sh_rest;
  gaussians.sh_rest_rows = cloud.sh_rest_rows;
  gaussians.sh_degree = 3;
  Rasterizer rasterizer(threads_);
  RasterImages images;
  images.color = again;
  rasterizer.forward(view.camera, gaussians, {}, images);
  EXPECT_EQ(shown, again);
}

TEST_F(DropGaussianRun, statistics_are_unbiased_under_the_compact_box) {
  // The same Gaussians and views with 3DGS's square, where dropped Gaussians count as seen, and with an exact compact
  // box, which lists none of them: mean gradients agree far better than by the possible bias of 1/(1 − rate).
  DropGaussianConfig config = eager();
  config.densify_interval = 90;
  config.densify_from = 0;
  config.opacity_reset_interval = 10000;
  config.drop_rate = 0.8;
  testing::NeverSteps never;  // parameters stay fixed: all views show the same Gaussians
  const auto mean_gradient = [&](std::optional<float> beta) {
    const auto backbone = make(config, 100);
    backbone->rasterizer_hook().set_beta(beta);
    DensityRecorder recorder;
    backbone->set_hooks(&recorder, &never);
    testing::train(*backbone, scene_, 1, 90);
    const std::vector<float>& gradients = recorder.events.at(0).gradients;
    return std::accumulate(gradients.begin(), gradients.end(), 0.0) / static_cast<double>(gradients.size());
  };
  const double square = mean_gradient(std::nullopt);
  EXPECT_NEAR(mean_gradient(1.0f) / square, 1, 0.05);
}

TEST_F(DropGaussianRun, decides_by_the_published_rules) {
  scene_.extent = 1;  // so that some Gaussians are larger than 0.1 of it
  DensityRecorder recorder;
  const auto backbone = make(eager(), kIterations, 600);  // the cap applies after the rules; it keeps the test short
  backbone->set_hooks(&recorder, nullptr);
  for (int i = 1; i <= kIterations; ++i) backbone->train_step(i, view_at(scene_, i));
  std::set<int> expected, growths, prunes;
  for (int i = 20; i < kIterations; i += 10) expected.insert(i);
  std::size_t growing = 0, spared = 0;
  const double extent = static_cast<double>(scene_.extent);
  for (const DensityEvent& e : recorder.events) {
    (e.growth ? growths : prunes).insert(e.iteration);
    for (std::size_t i = 0; i < e.clone.size(); ++i) {
      const bool moves = e.gradients[i] >= 5e-4f;
      const bool small = static_cast<double>(e.max_scales[i]) <= 0.01 * extent;
      EXPECT_EQ(e.clone[i] != 0, moves && small);
      EXPECT_EQ(e.split[i] != 0, moves && !small);
      growing += moves;
    }
    for (std::size_t i = 0; i < e.remove.size(); ++i) {
      EXPECT_EQ(e.remove[i] != 0, e.opacities[i] < 0.005f) << "size is no reason to go";
      spared += static_cast<double>(e.max_scales[i]) > 0.1 * extent && e.iteration > 60;
    }
  }
  EXPECT_EQ(growths, expected) << "to the end of the run";
  EXPECT_EQ(prunes, expected);
  EXPECT_GT(growing, 10u);
  EXPECT_GT(spared, 0u) << "the scene must exercise the rule";
}

/// Asks for pruning at an iteration that also densifies.
class PrunesAt40 : public DensityRecorder {
 public:
  bool prunes_at(Moment moment, bool) const override { return moment.iteration == 40; }
};

TEST_F(DropGaussianRun, late_pruning_comes_after_a_growth_of_the_same_iteration) {
  PrunesAt40 hook;
  const auto backbone = make(eager(), kIterations, 600);
  backbone->set_hooks(&hook, nullptr);
  testing::train(*backbone, scene_, 1, 45);
  std::vector<const DensityEvent*> at_40;
  for (const DensityEvent& e : hook.events) {
    if (e.iteration == 40) at_40.push_back(&e);
  }
  ASSERT_EQ(at_40.size(), 3u);
  EXPECT_TRUE(at_40[0]->growth);
  EXPECT_FALSE(at_40[1]->origins.empty()) << "the pruning that belongs to growth";
  EXPECT_TRUE(at_40[2]->origins.empty()) << "and the late one, of the set as it is";
}

/// Refuses the reset of opacities at an iteration.
class NoResetAt : public DensityRecorder {
 public:
  explicit NoResetAt(int iteration) : iteration_(iteration) {}
  bool resets_opacities_at(Moment moment, bool backbone_would) const override {
    return backbone_would && moment.iteration != iteration_;
  }

 private:
  int iteration_;
};

TEST_F(DropGaussianRun, a_hook_says_whether_opacities_are_reset) {
  DropGaussianConfig config = eager();
  config.opacity_reset_interval = 3000;
  const auto highest_after = [&](NoResetAt hook, int last) {
    const auto backbone = make(config, kIterations, 600);
    backbone->set_hooks(&hook, nullptr);
    testing::train(*backbone, scene_, 1, last);
    const std::vector<float> logits = exported(*backbone).logit_opacities;
    return *std::max_element(logits.begin(), logits.end());
  };
  const float reset = std::log(0.0101f / 0.9899f);
  EXPECT_GT(highest_after(NoResetAt(0), 59), reset);
  EXPECT_LT(highest_after(NoResetAt(0), 60), reset);
  EXPECT_GT(highest_after(NoResetAt(60), 60), reset);
}

TEST_F(DropGaussianRun, opacities_are_not_reset_shortly_before_the_end) {
  const auto highest_of = [&](int iterations) {
    const auto backbone = make(eager(), iterations, 600);  // resets every 50 iterations
    testing::train(*backbone, scene_, 1, 100);
    const std::vector<float> logits = exported(*backbone).logit_opacities;
    return *std::max_element(logits.begin(), logits.end());
  };
  const float reset = std::log(0.0101f / 0.9899f);
  EXPECT_LT(highest_of(112), reset);
  EXPECT_GT(highest_of(105), reset) << "five iterations are too few to recover";
}

TEST_F(DropGaussianRun, an_empty_view_shows_the_background_of_the_scene) {
  testing::expect_background_of_the_scene(
      [&](const Scene& scene) {
        return make_dropgaussian({scene, threads_, 3, kIterations, 0}, eager());
      },
      scene_);
}

TEST_F(DropGaussianRun, resume_is_exact) {
  testing::StepsEveryThird third;
  testing::expect_exact_resume([&] { return make(eager(), 100, 600); }, scene_, 90, {15, 20, 44, 85}, &third);
}

TEST_F(DropGaussianRun, a_hook_says_how_far_a_group_steps) {
  const auto backbone = make(eager(), 100, 600);
  testing::expect_rates_times_factor(*backbone, scene_, "opacity", "scaling");
}

TEST_F(DropGaussianRun, threads_do_not_change_the_bytes) {
  testing::expect_same_bytes_for_any_threads(
      [&](const Threads& threads) {
        return make_dropgaussian({scene_, threads, 3, 100, 600}, eager());
      },
      scene_, 80);
}

TEST_F(DropGaussianRun, reaches_a_stated_quality_on_a_tiny_scene) {
  const auto backbone = make({}, 400, 2000);
  testing::train(*backbone, scene_, 1, 400);
  backbone->finish();
  EXPECT_GT(quick_psnr(*backbone, scene_, 2), 20.0);
}

TEST(DropGaussianConfig, broken_ones_are_told_in_one_line) {
  const auto error = [](const nlohmann::json& json) {
    return test::input_error_of([&] { dropgaussian_config_from_json(json); });
  };
  test::expect_contains(error({{"droprate", 0.2}}), "unknown key 'droprate'");
  test::expect_contains(error({{"drop_rate", 1}}), "dropgaussian: drop_rate must lie in [0, 1)");
  test::expect_contains(error({{"drop_rate", "much"}}), "drop_rate");
  test::expect_contains(error({{"densify_interval", 0}}), "dropgaussian: intervals");
  EXPECT_EQ(to_json(dropgaussian_config_from_json({{"drop_rate", 0.1}}))["drop_rate"], 0.1);
  EXPECT_FALSE(to_json(DropGaussianConfig{}).contains("published_iterations"));
}

}  // namespace
}  // namespace splatboost

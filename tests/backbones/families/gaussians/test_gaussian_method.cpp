// SPDX-License-Identifier: Apache-2.0
// What a method of explicit Gaussians may change, tested on toy methods (support/toy_methods.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "splatboost/activations.h"
#include "support/density_recorder.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "support/toy_methods.h"
#include "vanilla/vanilla_adapter.h"

namespace splatboost {
namespace {

using testing::DensityEvent;
using testing::DensityRecorder;
using testing::exported;
using testing::MovingMethod;
using testing::OwnGroupsMethod;
using testing::OwnLossMethod;
using testing::state_of;

class GaussianMethodRun : public ::testing::Test {
 protected:
  GaussianMethodRun() { testing::spread_times(scene_); }

  BackboneContext context(int iterations = 60) { return {scene_, threads_, 3, iterations, 200}; }

  Threads threads_{2};
  Scene scene_ = testing::tiny_scene(threads_);
};

/// Clones all Gaussians, ranked by its own priority.
class Ranking : public DensityHook {
 public:
  void grow(const DensityStatistics& s, RasterizerHook&, GrowDecisions& d) override {
    caps.insert(s.max_primitives);
    count = d.clone.size();
    for (std::size_t i = 0; i < count; ++i) {
      d.clone[i] = 1;
      d.split[i] = 0;
      d.priorities[i] = static_cast<float>(i * 37 % count);  // a permutation: no count that occurs is a multiple of 37
    }
  }
  void prune(const DensityStatistics& s, RasterizerHook&, PruneDecisions& d) override {
    caps.insert(s.max_primitives);
    std::ranges::fill(d.remove, std::uint8_t{0});
    if (grown.empty()) grown.assign(d.origins.begin() + static_cast<std::ptrdiff_t>(count), d.origins.end());
  }
  std::size_t count = 0;
  std::vector<std::uint32_t> grown;  ///< Gaussians cloned by the first growth
  std::set<std::size_t> caps;        ///< that the backbone named
};

TEST_F(GaussianMethodRun, a_cap_ranks_by_what_the_hook_says) {
  BackboneContext capped = context();
  constexpr std::size_t kRoom = 3;
  capped.max_primitives = scene_.points.size() + kRoom;
  const auto backbone =
      make_gaussian_backbone(capped, testing::eager_toy_config(), std::make_unique<testing::ToyMethod>());
  Ranking ranking;
  backbone->set_hooks(&ranking, nullptr);
  for (int i = 1; i <= 8; ++i) backbone->train_step(i, scene_.train[0]);
  const std::size_t n = scene_.points.size();
  ASSERT_EQ(ranking.grown.size(), kRoom);
  for (const std::uint32_t i : ranking.grown) EXPECT_GE(i * 37 % n, n - kRoom);
  EXPECT_EQ(backbone->primitives(), capped.max_primitives);
  EXPECT_EQ(ranking.caps, (std::set<std::size_t>{capped.max_primitives}));
}

/// Splits all Gaussians and removes none.
class SplitsAll : public DensityHook {
 public:
  void grow(const DensityStatistics&, RasterizerHook&, GrowDecisions& d) override {
    std::ranges::fill(d.clone, std::uint8_t{0});
    std::ranges::fill(d.split, std::uint8_t{1});
  }
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions& d) override {
    std::ranges::fill(d.remove, std::uint8_t{0});
  }
};

TEST_F(GaussianMethodRun, children_of_the_flattest_have_a_scale) {
  BackboneContext uncapped = context();
  uncapped.max_primitives = 0;
  const auto backbone =
      make_gaussian_backbone(uncapped, testing::eager_toy_config(), std::make_unique<testing::ToyMethod>());
  SplatCloud cloud = exported(*backbone);
  const std::size_t n = cloud.size();
  for (std::size_t i = 0; i < n; ++i) cloud.log_scales[3 * i + 1] = -200;  // its exponential is 0
  testing::import_cloud(*backbone, cloud);
  SplitsAll splits;
  backbone->set_hooks(&splits, nullptr);
  for (int i = 1; i <= 60 && backbone->primitives() == n; ++i) backbone->train_step(i, scene_.train[0]);
  ASSERT_EQ(backbone->primitives(), 2 * n);
  for (const float scale : exported(*backbone).log_scales) EXPECT_TRUE(std::isfinite(scale) && scale < 0);
}

TEST_F(GaussianMethodRun, a_scored_view_is_drawn_at_its_own_time) {
  auto method = std::make_unique<MovingMethod>(threads_);
  MovingMethod& moving = *method;
  const auto backbone = make_gaussian_backbone(context(), testing::eager_toy_config(), std::move(method));
  testing::train(*backbone, scene_, 1, 5);
  moving.contexts.clear();
  for (std::size_t v = 0; v < scene_.train.size(); ++v) {
    const View& view = scene_.train[v];
    const ScoredView scored = backbone->rasterizer_hook().render_for_score(v);
    const std::vector<float> found(scored.color.begin(), scored.color.end());
    std::vector<float> own(found.size()), other(found.size());
    backbone->render(view.camera, view.time, std::nullopt, own);
    backbone->render(view.camera, view.time + 0.5f, std::nullopt, other);
    EXPECT_EQ(found, own) << v;
    EXPECT_NE(found, other) << v;
  }
  backbone->train_step(6, scene_.train[1]);
  const DrawContext& scored = moving.contexts[3];
  EXPECT_EQ(scored.purpose, DrawPurpose::score);
  EXPECT_EQ(scored.view, &scene_.train[1]);
  EXPECT_EQ(scored.time, scene_.train[1].time);
  EXPECT_EQ(scored.iteration, 5);
  EXPECT_EQ(moving.contexts[4].purpose, DrawPurpose::evaluate);
  EXPECT_EQ(moving.contexts[4].view, nullptr);
  EXPECT_EQ(moving.contexts.back().purpose, DrawPurpose::train);
  EXPECT_EQ(moving.contexts.back().view, &scene_.train[1]);
  EXPECT_EQ(moving.contexts.back().iteration, 6);
}

TEST_F(GaussianMethodRun, gradients_reach_means_and_rotations_through_a_motion) {
  const auto backbone =
      make_gaussian_backbone(context(), testing::eager_toy_config(), std::make_unique<MovingMethod>(threads_));
  testing::train(*backbone, scene_, 1, 30);  // makes scales anisotropic: rotations of spheres have no gradient
  SplatCloud cloud = exported(*backbone);
  std::ranges::fill(cloud.sh_rest, 0.0f);
  const View& view = scene_.train.back();
  const auto found = testing::gathered_gradients(*backbone, cloud, 1, view);

  // The motion in double precision, and the derivative of each moved number by finite differences.
  const auto moved = [&](double value, std::size_t gaussian, bool turns) {
    const double moves = cloud.means[3 * gaussian] > 0 ? 1 : 0;
    const auto time = static_cast<double>(view.time);
    const auto rate = static_cast<double>(turns ? MovingMethod::kTurn : MovingMethod::kMotion);
    return value * (1 + rate * time * moves);
  };
  const auto slope = [&](double value, std::size_t gaussian, bool turns) {
    return (moved(value + 1e-3, gaussian, turns) - moved(value - 1e-3, gaussian, turns)) / 2e-3;
  };
  SplatCloud there = cloud;
  std::vector<double> of_means, of_rotations;
  std::vector<float> scales(cloud.log_scales.size()), opacities(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      const auto mean = static_cast<double>(cloud.means[3 * i + c]);
      there.means[3 * i + c] = static_cast<float>(moved(mean, i, false));
      of_means.push_back(slope(mean, i, false));
    }
    const auto w = static_cast<double>(cloud.rotations[4 * i]);
    there.rotations[4 * i] = static_cast<float>(moved(w, i, true));
    of_rotations.insert(of_rotations.end(), {slope(w, i, true), 1, 1, 1});
  }
  exponentials(cloud.log_scales, scales, threads_);
  sigmoids(cloud.logit_opacities, opacities, threads_);
  const auto drawn = testing::gradients_of_view(there, scales, opacities, view, {}, 0.8f, 0.2f, threads_);
  for (std::size_t i = 0; i < of_means.size(); ++i) of_means[i] *= static_cast<double>(drawn.means[i]);
  for (std::size_t i = 0; i < of_rotations.size(); ++i) of_rotations[i] *= static_cast<double>(drawn.rotations[i]);
  testing::expect_close(found.means, of_means, 1e-4);
  testing::expect_close(found.rotations, of_rotations, 1e-4);
  EXPECT_NEAR(found.loss, drawn.loss, 1e-5);
}

TEST_F(GaussianMethodRun, a_motion_resumes_exactly) {
  testing::expect_exact_resume(
      [&] {
        return make_gaussian_backbone(context(), testing::eager_toy_config(), std::make_unique<MovingMethod>(threads_));
      },
      scene_, 40, {7, 20});
}

class OwnGroupsRun : public GaussianMethodRun {
 protected:
  std::unique_ptr<Backbone> make(const Threads& threads, const GaussianConfig& config = testing::eager_toy_config()) {
    return make_gaussian_backbone({scene_, threads, 3, 60, 200}, config, std::make_unique<OwnGroupsMethod>(threads));
  }
  std::unique_ptr<Backbone> make() { return make(threads_); }
};

TEST_F(OwnGroupsRun, rows_follow_growth_removal_and_order) {
  GaussianConfig config = testing::eager_toy_config();
  config.position_rate_initial = config.position_rate_final = 1e-30;  // means stay fixed and identify the Gaussians
  config.percent_dense = 0.06;
  config.min_opacity = 0.1;
  DensityRecorder recorder;
  const auto backbone = make(threads_, config);
  backbone->set_hooks(&recorder, nullptr);
  const std::vector<float> before = state_of(*backbone, "labels.values");
  testing::train(*backbone, scene_, 1, 4);
  ASSERT_EQ(recorder.events.size(), 2u);
  const DensityEvent &growth = recorder.events[0], &prune = recorder.events[1];
  const auto count = [](const std::vector<std::uint8_t>& mask) { return std::ranges::count(mask, std::uint8_t{1}); };
  EXPECT_GT(count(growth.clone), 0);
  EXPECT_GT(count(growth.split), 0);
  EXPECT_GT(count(prune.remove), 0) << "the scene must exercise removal";

  std::vector<float> expected;
  for (std::size_t i = 0; i < prune.remove.size(); ++i) {
    if (prune.remove[i] == 0) expected.push_back(before[prune.origins[i]]);
  }
  std::vector<float> labels = state_of(*backbone, "labels.values");
  const std::vector<float> means = state_of(*backbone, "xyz.values");
  ASSERT_EQ(labels.size(), backbone->primitives());
  std::size_t elsewhere = 0;
  for (std::size_t i = 0; i < labels.size(); ++i) elsewhere += labels[i] != means[3 * i] ? 1 : 0;
  EXPECT_GT(elsewhere, 0u) << "children of splits keep their parent's label";
  EXPECT_LE(elsewhere, 2 * static_cast<std::size_t>(count(growth.split)));
  std::ranges::sort(labels);
  std::ranges::sort(expected);
  EXPECT_EQ(labels, expected);
  EXPECT_EQ(state_of(*backbone, "factors.values").size(), backbone->primitives());
  EXPECT_EQ(state_of(*backbone, "shift.values").size(), 3u);
}

TEST_F(OwnGroupsRun, resume_is_exact) {
  testing::StepsEveryThird third;
  testing::expect_exact_resume([&] { return make(); }, scene_, 40, {7, 20}, &third);
}

TEST_F(OwnGroupsRun, averages_end_a_run) {
  testing::expect_averages_at_the_end([&] { return make(); }, scene_, 38,
                                      {"xyz", "f_rest", "scaling", "factors", "shift"});
}

TEST_F(OwnGroupsRun, threads_do_not_change_the_bytes) {
  testing::expect_same_bytes_for_any_threads([&](const Threads& threads) { return make(threads); }, scene_, 40);
}

TEST_F(OwnGroupsRun, the_optimizer_hook_sees_them_by_name) {
  testing::expect_rates_times_factor(*make(), scene_, "shift", "factors");
  testing::expect_rates_times_factor(*make(), scene_, "factors", "shift");
}

TEST_F(OwnGroupsRun, models_hold_them) {
  const test::TemporaryFolder folder;
  const auto backbone = make();
  testing::train(*backbone, scene_, 1, 30);
  backbone->finish();
  backbone->export_model(folder.path());
  const auto again = make();
  again->import_model(folder.path());
  EXPECT_EQ(testing::model_bytes(*again), testing::model_bytes(*backbone));
  std::filesystem::remove(folder / "parameters.bin");
  test::expect_contains(test::input_error_of([&] { make()->import_model(folder.path()); }), "parameters.bin");
  make()->export_model(folder.path());
  backbone->export_model(folder.path());
  std::filesystem::rename(folder / "parameters.bin", folder / "kept");
  make()->export_model(folder.path());  // a different number of Gaussians
  std::filesystem::rename(folder / "kept", folder / "parameters.bin");
  test::expect_contains(test::input_error_of([&] { make()->import_model(folder.path()); }),
                        "'factors' does not match point_cloud.ply");
}

TEST_F(OwnGroupsRun, memory_counts_them) {
  const auto without =
      make_gaussian_backbone(context(), testing::eager_toy_config(), std::make_unique<testing::ToyMethod>());
  EXPECT_EQ(make()->bytes_per_primitive(), without->bytes_per_primitive() + 2 * 4 * sizeof(float));
}

class OwnLossRun : public GaussianMethodRun {
 protected:
  std::unique_ptr<Backbone> make(bool two_views, float weight = 1, LossForm form = {0.2f, 0}, int iterations = 60) {
    return make_gaussian_backbone(context(iterations), testing::eager_toy_config(),
                                  std::make_unique<OwnLossMethod>(threads_, scene_, two_views, weight, form));
  }
  /// The Gaussians of a short run, without view-dependent colour.
  SplatCloud some_cloud() {
    const auto backbone = make(false);
    testing::train(*backbone, scene_, 1, 20);
    SplatCloud cloud = exported(*backbone);
    std::ranges::fill(cloud.sh_rest, 0.0f);
    return cloud;
  }
};

TEST_F(OwnLossRun, gradients_are_those_of_the_images_that_it_read) {
  const SplatCloud cloud = some_cloud();
  const View& view = scene_.train[0];  // at time 0 nothing is displaced
  ASSERT_EQ(view.time, 0.0f);
  const auto found = testing::gathered_gradients(*make(false), cloud, 1, view);

  std::vector<float> scales(cloud.log_scales.size()), opacities(cloud.size());
  exponentials(cloud.log_scales, scales, threads_);
  sigmoids(cloud.logit_opacities, opacities, threads_);
  Gaussians gaussians;
  gaussians.count = cloud.size();
  gaussians.means = cloud.means;
  gaussians.scales = scales;
  gaussians.rotations = cloud.rotations;
  gaussians.opacities = opacities;
  gaussians.sh_dc = cloud.sh_dc;
  const std::size_t pixels = view.color.size() / 3;
  std::vector<float> color(3 * pixels), inverse_depth(pixels), alpha(pixels, 0);
  RasterImages images;
  images.color = color;
  images.inverse_depth = inverse_depth;
  images.alpha = alpha;
  Rasterizer rasterizer(threads_);
  rasterizer.forward(view.camera, gaussians, {}, images);
  double loss = 0;
  for (std::size_t p = 0; p < 3 * pixels; ++p) {
    const float difference = color[p] - view.color[p] / 255.0f;
    loss += static_cast<double>(difference * difference) / static_cast<double>(3 * pixels);
    color[p] = 2 * difference / static_cast<float>(3 * pixels);
  }
  for (std::size_t p = 0; p < pixels; ++p) {
    loss += static_cast<double>(inverse_depth[p] * inverse_depth[p] + alpha[p]) / static_cast<double>(pixels);
    inverse_depth[p] *= 2 / static_cast<float>(pixels);
    alpha[p] = 1 / static_cast<float>(pixels);
  }
  std::vector<float> means(cloud.means.size()), of_scales(scales.size()), of_opacities(cloud.size());
  GaussianGradients gradients;
  gradients.means = means;
  gradients.scales = of_scales;
  gradients.opacities = of_opacities;
  RasterImageGradients of_images;
  of_images.color = color;
  of_images.inverse_depth = inverse_depth;
  of_images.alpha = alpha;
  rasterizer.backward(gaussians, of_images, gradients);
  EXPECT_NEAR(found.loss, loss, 1e-6);
  testing::expect_close(found.means, {means.begin(), means.end()}, 1e-4);
  testing::expect_close(found.scales, {of_scales.begin(), of_scales.end()}, 1e-4);
  testing::expect_close(found.opacities, {of_opacities.begin(), of_opacities.end()}, 1e-4);
}

TEST_F(OwnLossRun, gradients_of_a_second_view_are_added_at_its_own_time) {
  const SplatCloud cloud = some_cloud();
  const View &one = scene_.train[1], &other = scene_.train[2];
  const auto both = testing::gathered_gradients(*make(true), cloud, 1, one);
  const auto of_one = testing::gathered_gradients(*make(false), cloud, 1, one);
  const auto of_other = testing::gathered_gradients(*make(false), cloud, 1, other);
  EXPECT_NEAR(both.loss, of_one.loss + of_other.loss, 1e-9);
  const auto sum = [](const std::vector<float>& a, const std::vector<float>& b) {
    std::vector<double> sums;
    for (std::size_t i = 0; i < a.size(); ++i) sums.push_back(static_cast<double>(a[i]) + static_cast<double>(b[i]));
    return sums;
  };
  testing::expect_close(both.means, sum(of_one.means, of_other.means), 1e-5);
  testing::expect_close(both.rotations, sum(of_one.rotations, of_other.rotations), 1e-5);
  testing::expect_close(both.scales, sum(of_one.scales, of_other.scales), 1e-5);
  testing::expect_close(both.opacities, sum(of_one.opacities, of_other.opacities), 1e-5);
}

TEST_F(OwnLossRun, adds_to_the_usual_loss) {
  const SplatCloud cloud = some_cloud();
  const View& view = scene_.train[1];
  const auto both = testing::gathered_gradients(*make(false, 1, {0.2f, 1}), cloud, 1, view);
  const auto usual = testing::gathered_gradients(*make(false, 0, {0.2f, 1}), cloud, 1, view);
  const auto own = testing::gathered_gradients(*make(false), cloud, 1, view);
  EXPECT_NEAR(both.loss, usual.loss + own.loss, 1e-9);
  std::vector<double> sums;
  for (std::size_t i = 0; i < own.means.size(); ++i) {
    sums.push_back(static_cast<double>(usual.means[i]) + static_cast<double>(own.means[i]));
  }
  testing::expect_close(both.means, sums, 1e-5);
}

TEST_F(OwnLossRun, a_second_view_without_weight_changes_nothing) {
  const auto bytes = [&](bool two_views) {
    const auto backbone = make(two_views, 0, {0.2f, 1});
    testing::train(*backbone, scene_, 1, 30);
    EXPECT_GT(backbone->primitives(), scene_.points.size()) << "this run shall grow";
    return testing::model_bytes(*backbone);
  };
  EXPECT_EQ(bytes(true), bytes(false));
}

TEST_F(OwnLossRun, resume_is_exact) {
  testing::expect_exact_resume([&] { return make(true); }, scene_, 40, {7, 20});
}

TEST_F(GaussianMethodRun, what_a_method_trims_goes_whatever_the_adapter_prunes) {
  VanillaBoost boost;
  boost.views = 2;
  VanillaAdapter adapter(boost, threads_);
  const auto backbone =
      make_gaussian_backbone(context(), testing::eager_toy_config(), std::make_unique<testing::TrimmingMethod>());
  backbone->set_hooks(&adapter, nullptr);
  testing::train(*backbone, scene_, 1, 9);
  const auto fainter = [&] {
    std::vector<float> opacities = exported(*backbone).logit_opacities;
    sigmoids(opacities, opacities, threads_);
    return std::ranges::count_if(opacities, [](float o) { return o < testing::TrimmingMethod::kFaint; });
  };
  EXPECT_GT(fainter(), 0) << "the scene must exercise the rule";
  testing::train(*backbone, scene_, 10, 10);
  EXPECT_EQ(fainter(), 0);
}

TEST_F(GaussianMethodRun, a_hook_is_told_whose_rule_removes) {
  class Recorder : public DensityRecorder {
    bool prunes_at(Moment moment, bool) const override { return moment.iteration == 20; }
  } recorder;
  const auto backbone =
      make_gaussian_backbone(context(), testing::eager_toy_config(), std::make_unique<testing::TrimmingMethod>());
  backbone->set_hooks(&recorder, nullptr);
  testing::train(*backbone, scene_, 1, 20);
  std::vector<PruneRule> at_10, at_20;
  for (const DensityEvent& e : recorder.events) {
    if (e.growth) continue;
    EXPECT_EQ(e.origins.empty(), e.rule != PruneRule::growth);
    if (e.iteration == 10) at_10.push_back(e.rule);
    if (e.iteration == 20) at_20.push_back(e.rule);
  }
  EXPECT_EQ(at_10, (std::vector<PruneRule>{PruneRule::trim}));
  EXPECT_EQ(at_20, (std::vector<PruneRule>{PruneRule::growth, PruneRule::trim, PruneRule::late}));
}

}  // namespace
}  // namespace splatboost

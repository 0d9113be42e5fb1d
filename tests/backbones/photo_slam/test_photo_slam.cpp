// SPDX-License-Identifier: Apache-2.0
// Photo-SLAM's mapper: its schedule, its pyramids, and views, points and corrections that arrive during training.
#include "photo_slam/photo_slam.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "photo_slam/keyframe_schedule.h"
#include "photo_slam/photo_slam_adapter.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "trainer/backbone_api/online_backbone.h"

namespace splatboost {
namespace {

using testing::exported;

TEST(KeyframeSchedule, begins_with_small_images_and_uses_all_alike) {
  KeyframeSchedule schedule(4, 2, 3, 1);
  for (int i = 0; i < 3; ++i) schedule.add();
  std::map<std::size_t, std::vector<int>> levels;
  for (int i = 1; i <= 30; ++i) {
    const KeyframeSchedule::Choice choice = schedule.next(i);
    levels[choice.keyframe].push_back(choice.level);
  }
  ASSERT_EQ(levels.size(), 3u);
  for (const auto& [keyframe, of] : levels) {
    EXPECT_EQ(of, (std::vector<int>{2, 2, 2, 1, 1, 1, 0, 0, 0, 0})) << keyframe;
    EXPECT_EQ(schedule.used(keyframe), 10);
  }
}

TEST(KeyframeSchedule, a_new_keyframe_has_its_uses_before_the_others_have_more) {
  KeyframeSchedule schedule(8, 0, 0, 1);
  schedule.add();
  schedule.add();
  for (int i = 1; i <= 16; ++i) schedule.next(i);
  schedule.add();
  std::vector<std::size_t> chosen;
  for (int i = 17; i <= 24; ++i) chosen.push_back(schedule.next(i).keyframe);
  EXPECT_EQ(chosen, std::vector<std::size_t>(8, 2));
  std::set<std::size_t> after;
  for (int i = 25; i <= 27; ++i) after.insert(schedule.next(i).keyframe);
  EXPECT_EQ(after.size(), 3u);
  schedule.add_uses(1, 2);
  EXPECT_EQ(schedule.next(28).keyframe, 1u);
}

/// A run that starts with two views; the others arrive one by one.
class OnlineRun : public ::testing::Test {
 protected:
  static constexpr int kIterations = 60;

  static PhotoSlamConfig eager() {
    PhotoSlamConfig config;
    config.densify_interval = 10;
    config.gradient_threshold = 2e-4;
    config.feature_cache = 2;
    config.protected_iterations = 15;
    config.keyframe_uses = 2;
    config.level_uses = 1;
    return config;
  }

  struct Run {
    Scene scene;
    std::unique_ptr<Backbone> backbone;
    OnlineBackbone* online = nullptr;
    int iteration = 0;
    void step(int count) {
      for (int i = 0; i < count; ++i) {
        ++iteration;
        backbone->train_step(iteration, online->next_view(iteration));
      }
    }
  };

  Run begin(const Threads& threads, const PhotoSlamConfig& config, std::size_t cap = 0) {
    Run run;
    run.scene = all_;
    run.scene.train.resize(2);
    scenes_.push_back(std::make_unique<Scene>(std::move(run.scene)));
    run.backbone = make_photo_slam({*scenes_.back(), threads, 3, kIterations, cap}, config);
    run.online = dynamic_cast<OnlineBackbone*>(run.backbone.get());
    run.online->map_changed({});
    return run;
  }
  /// Adds one view, and points that it sees.
  void add_view(Run& run, std::vector<glm::dmat4> corrections = {}) {
    Scene& scene = *scenes_.back();
    const std::size_t number = scene.train.size();
    scene.train.push_back(all_.train[number]);
    MapChange change;
    change.map_points = points(number, 6, 0.3f);
    change.features = points(number, 9, 0.6f);
    change.corrections = std::move(corrections);
    run.online->map_changed(change);
  }
  static SeenPoints points(std::size_t view, int count, float at) {
    SeenPoints seen;
    for (int i = 0; i < count; ++i) {
      for (const float x : {at, 0.1f * static_cast<float>(i), 0.05f * static_cast<float>(view)}) {
        seen.points.positions.push_back(x);
      }
      seen.points.colors.insert(seen.points.colors.end(), 3, 200);
      seen.views.push_back(static_cast<std::uint32_t>(view));
    }
    return seen;
  }

  Threads threads_{2};
  Scene all_ = testing::tiny_scene(threads_, 8, 64, 48);
  std::vector<std::unique_ptr<Scene>> scenes_;
};

TEST_F(OnlineRun, map_points_come_at_once_and_features_when_the_cache_is_full) {
  Run run = begin(threads_, eager());
  const std::size_t n = run.backbone->primitives();
  run.step(1);
  EXPECT_EQ(run.backbone->primitives(), n);
  add_view(run);
  run.step(1);
  EXPECT_EQ(run.backbone->primitives(), n + 6);
  add_view(run);
  run.step(1);
  EXPECT_EQ(run.backbone->primitives(), n + 12 + 18);
  add_view(run);
  run.online->views_complete(40);
  run.step(1);
  EXPECT_EQ(run.backbone->primitives(), n + 18 + 27);  // the cache is flushed
}

TEST_F(OnlineRun, views_are_scored_and_trained_on_from_when_they_come) {
  Run run = begin(threads_, eager());
  EXPECT_EQ(run.backbone->rasterizer_hook().scorable_views(), 2u);
  run.step(8);
  add_view(run);
  EXPECT_EQ(run.backbone->rasterizer_hook().scorable_views(), 3u);
  // The new view is trained on next: first at a quarter, then at half of its size.
  EXPECT_EQ(run.online->next_view(9).camera.width, 16);
  EXPECT_EQ(run.online->next_view(10).camera.width, 32);
}

TEST_F(OnlineRun, a_loop_moves_gaussians_with_the_view_they_are_of) {
  PhotoSlamConfig config = eager();
  config.densify_from = 10000;
  Run run = begin(threads_, config);
  add_view(run);
  testing::NeverSteps never;
  run.backbone->set_hooks(nullptr, &never);
  run.step(1);
  const SplatCloud before = exported(*run.backbone);
  glm::dmat4 shifted(1.0);
  shifted[3] = {0.25, 0, 0, 1};
  add_view(run, {glm::dmat4(1.0), glm::dmat4(1.0), shifted});
  run.step(1);
  const SplatCloud after = exported(*run.backbone);
  // The last 6 points before belong to the moved view; 6 of the newest view and 18 from the cache are added. Points in
  // the cache move too.
  ASSERT_EQ(after.size(), before.size() + 6 + 18);
  // The accumulated gradients were applied first, hence the tolerance.
  constexpr double kStep = 0.005;
  std::size_t moved = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const float off = after.means[3 * i] - before.means[3 * i];
    if (i + 6 >= before.size()) {
      EXPECT_NEAR(off, 0.25f, kStep) << i;
      ++moved;
    } else {
      EXPECT_NEAR(off, 0, kStep) << i;
    }
  }
  EXPECT_EQ(moved, 6u);
  std::vector<float> features;
  for (std::size_t i = before.size() + 6; i < after.size(); ++i) features.push_back(after.means[3 * i]);
  EXPECT_EQ(std::ranges::count_if(features, [](float x) { return std::abs(x - 0.85f) < 1e-5f; }), 9);
  EXPECT_EQ(std::ranges::count_if(features, [](float x) { return std::abs(x - 0.6f) < 1e-5f; }), 9);
}

TEST_F(OnlineRun, a_loop_corrects_the_scale_where_it_drifts) {
  PhotoSlamConfig config = eager();
  config.densify_from = 10000;
  Run run = begin(threads_, config);
  add_view(run);
  testing::NeverSteps never;
  run.backbone->set_hooks(nullptr, &never);
  run.step(1);
  const SplatCloud before = exported(*run.backbone);
  glm::dmat4 doubled(2.0);
  doubled[3] = {0, 0, 0.5, 1};
  add_view(run, {glm::dmat4(1.0), glm::dmat4(1.0), doubled});
  run.step(1);
  const SplatCloud after = exported(*run.backbone);
  ASSERT_EQ(after.size(), before.size() + 6 + 18);
  constexpr double kStep = 0.01;  // the accumulated gradients were applied first
  for (std::size_t i = before.size() - 6; i < before.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(after.means[3 * i + c], 2 * before.means[3 * i + c] + (c == 2 ? 0.5f : 0), kStep) << i;
      EXPECT_NEAR(after.log_scales[3 * i + c] - before.log_scales[3 * i + c], std::log(2.0), kStep) << i;
    }
  }
  std::size_t features = 0;  // of the view, which wait for insertion
  for (std::size_t i = before.size() + 6; i < after.size(); ++i)
    features += std::abs(after.means[3 * i] - 1.2f) < 1e-5f;
  EXPECT_EQ(features, 9u);
}

TEST_F(OnlineRun, the_second_half_waits_for_the_last_view) {
  Run run = begin(threads_, eager());
  EXPECT_EQ(run.online->planned_iterations(10), kIterations);
  EXPECT_EQ(run.online->planned_iterations(50), 102);
  run.online->views_complete(70);
  EXPECT_EQ(run.online->planned_iterations(65), 70);
}

/// Removes everything that it may, once.
class RemovesAll : public DensityHook {
 public:
  explicit RemovesAll(int at) : at_(at) {}
  bool grows_at(Moment, bool) const override { return false; }
  void grow(const DensityStatistics&, RasterizerHook&, GrowDecisions&) override {}
  bool prunes_at(Moment moment, bool) const override { return moment.iteration == at_; }
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions& d) override {
    std::ranges::fill(d.remove, std::uint8_t{1});
  }

 private:
  int at_;
};

TEST_F(OnlineRun, a_hook_cannot_remove_what_has_just_come_nor_anything_after_a_loop) {
  for (const bool loop : {false, true}) {
    Run run = begin(threads_, eager());
    RemovesAll early(6), late(30);
    run.backbone->set_hooks(&early, nullptr);
    run.step(4);
    add_view(run, loop ? std::vector<glm::dmat4>(3, glm::dmat4(1.0)) : std::vector<glm::dmat4>{});
    const std::size_t n = run.backbone->primitives();
    run.step(2);
    EXPECT_EQ(run.backbone->primitives(), loop ? n + 6 : 6u);
    run.backbone->set_hooks(&late, nullptr);
    run.step(24);
    EXPECT_EQ(run.backbone->primitives(), 1u);
  }
}

TEST_F(OnlineRun, a_late_pruning_that_is_due_after_a_loop_is_delayed) {
  PhotoSlamBoost settings;
  settings.gradient_threshold = settings.gradient_abs_threshold = 1;  // nothing grows
  settings.late_max_score = 0;                                        // what has any error goes
  for (const bool loop : {false, true}) {
    Run run = begin(threads_, eager());
    PhotoSlamAdapter adapter(settings, threads_);
    run.backbone->set_hooks(&adapter, nullptr);
    run.step(4);
    add_view(run, loop ? std::vector<glm::dmat4>(3, glm::dmat4(1.0)) : std::vector<glm::dmat4>{});
    run.online->views_complete(24);  // growth ends at 12, protection after the loop at 20
    run.step(7);
    const std::size_t before = run.backbone->primitives();
    run.step(4);
    EXPECT_EQ(run.backbone->primitives() < before, !loop);
    run.step(7);
    EXPECT_LT(run.backbone->primitives(), before);
  }
}

TEST_F(OnlineRun, the_same_bytes_for_any_number_of_threads) {
  const auto bytes = [&](int count, bool boost) {
    Threads threads(count);
    PhotoSlamConfig config = eager();
    Run run = begin(threads, config, 300);
    PhotoSlamBoost settings;
    settings.densify_interval = 10;
    settings.gradient_threshold = settings.gradient_abs_threshold = 1e-5;
    settings.tau_d = 0;
    PhotoSlamAdapter adapter(settings, threads);
    if (boost) {
      run.backbone->rasterizer_hook().set_beta(adapter.beta());
      run.backbone->set_hooks(&adapter, &adapter);
    }
    for (int i = 0; i < 3; ++i) {
      run.step(7);
      add_view(run, i == 2 ? std::vector<glm::dmat4>(5, glm::dmat4(1.0)) : std::vector<glm::dmat4>{});
    }
    run.online->views_complete(kIterations);
    run.step(kIterations - 21);
    run.backbone->finish();
    return testing::model_bytes(*run.backbone);
  };
  for (const bool boost : {false, true}) {
    const std::string one = bytes(1, boost);
    EXPECT_EQ(one, bytes(3, boost)) << boost;
  }
  EXPECT_NE(bytes(1, false), bytes(1, true));
}

TEST_F(OnlineRun, a_scene_that_is_all_there_resumes_exactly) {
  testing::expect_exact_resume([&] { return make_photo_slam({all_, threads_, 3, 24, 0}, eager()); }, all_, 24, {11});
}

TEST(PhotoSlamConfig, wrong_constants_are_named) {
  const auto error = [](const char* json) -> std::string {
    try {
      photo_slam_config_from_json(nlohmann::json::parse(json));
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_NE(error(R"({"pyramid_levels": 9})").find("pyramid_levels"), std::string::npos);
  EXPECT_NE(error(R"({"keyframe_uses": 0})").find("keyframe_uses"), std::string::npos);
  EXPECT_NE(error(R"({"keyframes": 1})").find("unknown key 'keyframes'"), std::string::npos);
  const PhotoSlamConfig config = photo_slam_config_from_json(nlohmann::json::parse(R"({"feature_cache": 3})"));
  EXPECT_EQ(config.feature_cache, 3);
  EXPECT_EQ(photo_slam_config_from_json(to_json(config)).feature_cache, 3);
}

}  // namespace
}  // namespace splatboost

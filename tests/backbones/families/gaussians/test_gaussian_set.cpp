// SPDX-License-Identifier: Apache-2.0
// Gaussians added, moved and kept by the method itself, outside of density control, on a toy method.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <vector>

#include <glm/gtc/quaternion.hpp>

#include "splatboost/clearance.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "support/toy_methods.h"

namespace splatboost {
namespace {

using testing::exported;

/// Calls at_edit at each iteration, labels its Gaussians, and spares those labelled 0 from pruning.
class MapperMethod : public testing::ToyMethod {
 public:
  explicit MapperMethod(Device device) : labels_{"labels", 1, device, [](int) { return 0.0; }} {
    labels_.in_model = false;
  }

  std::vector<TrainedGroup*> groups() override { return {&labels_}; }
  void start(std::span<const float> means) override { labels_.assign(std::vector<float>(means.size() / 3, 1.0f)); }
  void edit(GaussianSet& set, int iteration) override {
    if (at_edit) at_edit(set, iteration);
  }
  void spare(Moment, PruneRule rule, std::span<std::uint8_t> remove) override {
    spared_rules.push_back(rule);
    const std::vector<float> labels = labels_.values.to_host();
    for (std::size_t i = 0; i < remove.size(); ++i) {
      if (labels[i] == 0) remove[i] = 0;
    }
  }
  int planned_iterations(int, int given) const override { return given + longer; }

  std::function<void(GaussianSet&, int)> at_edit;
  std::vector<PruneRule> spared_rules;
  int longer = 0;
  TrainedGroup labels_;
};

/// Removes everything at a given iteration.
class RemovesAll : public DensityHook {
 public:
  explicit RemovesAll(int at) : at_(at) {}
  bool grows_at(Moment moment, bool) const override {
    seen = moment;
    return false;
  }
  void grow(const DensityStatistics&, RasterizerHook&, GrowDecisions&) override {}
  bool prunes_at(Moment moment, bool) const override { return moment.iteration == at_; }
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions& decisions) override {
    std::ranges::fill(decisions.remove, std::uint8_t{1});
  }
  mutable Moment seen;

 private:
  int at_;
};

/// Removes the half that is nearest to a camera.
class ClearsCameras : public DensityHook {
 public:
  bool needs_clearances() const override { return asks; }
  bool grows_at(Moment, bool) const override { return false; }
  void grow(const DensityStatistics&, RasterizerHook&, GrowDecisions&) override {}
  bool prunes_at(Moment, bool) const override { return true; }
  void prune(const DensityStatistics& statistics, RasterizerHook&, PruneDecisions& decisions) override {
    given.assign(statistics.clearances.begin(), statistics.clearances.end());
    std::vector<float> sorted = given;
    std::ranges::sort(sorted);
    for (std::size_t i = 0; i < given.size(); ++i) decisions.remove[i] = given[i] < sorted[sorted.size() / 2] ? 1 : 0;
  }
  bool asks = false;
  std::vector<float> given;
};

PointCloud three_points() { return {{0.5f, 0, 0, 0.5f, 0.1f, 0, 0.5f, 0, 0.1f}, {255, 0, 0, 0, 255, 0, 0, 0, 255}}; }

class GaussianSetRun : public ::testing::Test {
 protected:
  std::unique_ptr<Backbone> make(std::size_t cap = 0) {
    auto method = std::make_unique<MapperMethod>(threads_);
    method_ = method.get();
    GaussianConfig config;
    config.densify_from = 10000;
    return make_gaussian_backbone({scene_, threads_, 3, 40, cap}, config, std::move(method));
  }

  Threads threads_{2};
  Scene scene_ = testing::tiny_scene(threads_);
  MapperMethod* method_ = nullptr;
};

TEST_F(GaussianSetRun, inserted_gaussians_come_last_as_a_start_would_make_them) {
  const auto backbone = make();
  const SplatCloud before = exported(*backbone);
  testing::NeverSteps never;
  backbone->set_hooks(nullptr, &never);
  method_->at_edit = [&](GaussianSet& set, int) {
    EXPECT_EQ(set.insert(three_points()), (std::vector<std::uint32_t>{0, 1, 2}));
    EXPECT_EQ(set.size(), before.size() + 3);
  };
  backbone->train_step(1, scene_.train[0]);
  const SplatCloud after = exported(*backbone);
  ASSERT_EQ(after.size(), before.size() + 3);
  EXPECT_TRUE(std::equal(before.means.begin(), before.means.end(), after.means.begin()));
  const PointCloud points = three_points();
  EXPECT_TRUE(std::equal(points.positions.begin(), points.positions.end(), after.means.end() - 9));
  // Squared distances to the other two points: 0.01 and 0.01 for the first, 0.01 and 0.02 for the second and third.
  EXPECT_NEAR(after.log_scales[3 * before.size()], 0.5 * std::log(0.01), 1e-5);
  EXPECT_NEAR(after.log_scales[3 * before.size() + 3], 0.5 * std::log(0.015), 1e-5);
  EXPECT_NEAR(after.logit_opacities.back(), std::log(0.1 / 0.9), 1e-6);
  EXPECT_EQ(after.rotations[4 * before.size()], 1);
  EXPECT_NEAR(after.sh_dc[3 * before.size()], 0.5 / 0.28209479, 1e-5);
  EXPECT_NEAR(after.sh_dc[3 * before.size() + 1], -0.5 / 0.28209479, 1e-5);
  EXPECT_EQ(method_->labels_.rows(), after.size());
  EXPECT_EQ(method_->labels_.values.to_host().back(), 0);
}

TEST_F(GaussianSetRun, inserting_keeps_the_gradients_that_wait_for_a_step) {
  testing::StepsEveryThird third;
  const auto inserting = [&] {
    auto backbone = make();
    method_->at_edit = [&](GaussianSet& set, int iteration) {
      if (iteration == 3 || iteration == 8) set.insert(three_points());
    };
    return backbone;
  };
  // A resumed run has gradients where the whole run has factors of views (sh_rest_group.h).
  testing::expect_exact_resume(inserting, scene_, 10, {2, 7}, &third);
}

TEST_F(GaussianSetRun, pruning_knows_how_near_the_cameras_gaussians_are) {
  scene_ = testing::tiny_scene(threads_, 6, 48, 40, 60, 100);
  for (std::size_t i = 0; i < scene_.points.positions.size(); i += 3) scene_.points.positions[i] = 0;  // a surface
  const auto backbone = make();
  ClearsCameras hook;
  backbone->set_hooks(&hook, nullptr);
  backbone->train_step(1, scene_.train[0]);
  EXPECT_TRUE(hook.given.empty()) << "nobody asked";

  hook.asks = true;
  backbone->train_step(2, scene_.train[1]);
  const SplatCloud left = exported(*backbone);
  ASSERT_LT(left.size(), hook.given.size());
  std::vector<float> centres, distances(scene_.train.size()), expected(left.size());
  for (const View& view : scene_.train) {
    const glm::vec3 centre = view.camera.centre();
    centres.insert(centres.end(), {centre.x, centre.y, centre.z});
  }
  distances_to_scene(centres, scene_.points.positions, distances, threads_);
  camera_clearances(left.means, centres, distances, expected, threads_);
  EXPECT_GT(*std::ranges::min_element(distances), 0.0f);
  std::ranges::sort(hook.given);
  std::ranges::sort(expected);
  EXPECT_TRUE(std::equal(expected.rbegin(), expected.rend(), hook.given.rbegin()));
}

TEST_F(GaussianSetRun, inserting_holds_the_cap) {
  const auto backbone = make(42);
  method_->at_edit = [](GaussianSet& set, int) {
    const std::size_t room = 42 - set.size();
    EXPECT_EQ(set.insert(three_points()).size(), std::min<std::size_t>(room, 3));
  };
  for (int i = 1; i <= 3; ++i) backbone->train_step(i, scene_.train[0]);
  EXPECT_EQ(backbone->primitives(), 42u);
}

TEST_F(GaussianSetRun, a_transform_moves_turns_and_scales_those_it_names) {
  const auto backbone = make();
  testing::train(*backbone, scene_, 1, 5);
  const SplatCloud before = exported(*backbone);
  testing::NeverSteps never;
  backbone->set_hooks(nullptr, &never);
  const glm::dquat turn = glm::angleAxis(0.7, glm::normalize(glm::dvec3(1, 2, -1)));
  const Similarity by{glm::mat3_cast(turn), {0.3, -0.2, 0.1}, 1.5};
  method_->at_edit = [&](GaussianSet& set, int) {
    std::vector<std::int32_t> which(set.size(), -1);
    which[4] = 0;
    set.transform(which, std::span(&by, 1));
  };
  backbone->train_step(6, scene_.train[0]);
  const SplatCloud after = exported(*backbone);
  for (std::size_t i = 0; i < before.size(); ++i) {
    glm::dvec3 mean(before.means[3 * i], before.means[3 * i + 1], before.means[3 * i + 2]);
    glm::dquat q(before.rotations[4 * i], before.rotations[4 * i + 1], before.rotations[4 * i + 2],
                 before.rotations[4 * i + 3]);
    double longer = 0;
    if (i == 4) {
      mean = 1.5 * (by.rotation * mean) + by.translation;
      q = turn * q;
      longer = std::log(1.5);
    }
    const double wxyz[4] = {q.w, q.x, q.y, q.z};
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(after.means[3 * i + c], mean[static_cast<int>(c)], 1e-6) << i;
      EXPECT_NEAR(after.log_scales[3 * i + c], before.log_scales[3 * i + c] + longer, 1e-6) << i;
    }
    for (std::size_t c = 0; c < 4; ++c) EXPECT_NEAR(after.rotations[4 * i + c], wxyz[c], 1e-6) << i;
  }
}

TEST_F(GaussianSetRun, a_hook_cannot_remove_what_is_spared) {
  const auto backbone = make();
  RemovesAll hook(7);
  backbone->set_hooks(&hook, nullptr);
  method_->at_edit = [](GaussianSet& set, int iteration) {
    if (iteration == 6) set.insert(three_points());
  };
  testing::train(*backbone, scene_, 1, 7);
  EXPECT_EQ(method_->spared_rules, std::vector<PruneRule>{PruneRule::late});
  EXPECT_EQ(backbone->primitives(), 3u);
}

TEST_F(GaussianSetRun, hooks_see_the_planned_length) {
  const auto backbone = make();
  RemovesAll hook(1000);
  backbone->set_hooks(&hook, nullptr);
  method_->longer = 25;
  backbone->train_step(1, scene_.train[0]);
  EXPECT_EQ(hook.seen.total, 65);
}

TEST_F(GaussianSetRun, models_are_without_groups_of_training) {
  const auto backbone = make();
  const test::TemporaryFolder folder;
  backbone->export_model(folder.path());
  EXPECT_FALSE(std::filesystem::exists(folder / "parameters.bin"));
  make()->import_model(folder.path());
}

}  // namespace
}  // namespace splatboost

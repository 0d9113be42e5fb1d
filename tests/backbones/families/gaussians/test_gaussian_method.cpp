// SPDX-License-Identifier: Apache-2.0
// What a method of explicit Gaussians may change, proven on methods made for it (support/toy_methods.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "splatboost/activations.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "support/toy_methods.h"

namespace splatboost {
namespace {

using testing::exported;
using testing::MovingMethod;

class GaussianMethodRun : public ::testing::Test {
 protected:
  GaussianMethodRun() { testing::spread_times(scene_); }

  BackboneContext context(int iterations = 60) { return {scene_, threads_, 3, iterations, 200}; }

  Threads threads_{2};
  Scene scene_ = testing::tiny_scene(threads_);
};

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
  testing::train(*backbone, scene_, 1, 30);  // rotations matter where scales differ
  SplatCloud cloud = exported(*backbone);
  std::ranges::fill(cloud.sh_rest, 0.0f);
  const View& view = scene_.train.back();
  const auto found = testing::gathered_gradients(*backbone, cloud, 1, view);

  // The motion in double, and the derivative of each number that it makes by differences.
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

}  // namespace
}  // namespace splatboost

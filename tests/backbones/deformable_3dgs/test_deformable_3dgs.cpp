// SPDX-License-Identifier: Apache-2.0
// Training Deformable-3DGS: which motion is drawn when, learning rates and noise, published decisions, resume, quality.
#include "deformable_3dgs/deformable_3dgs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "deformable_3dgs/deformation_field.h"
#include "splatboost/activations.h"
#include "support/density_recorder.h"
#include "support/gaussian_checks.h"
#include "support/moving_scene.h"
#include "trainer/backbone_api/backbone_entry.h"

namespace splatboost {

BackboneEntry deformable_3dgs_entry();

namespace {

using testing::DensityEvent;
using testing::DensityRecorder;
using testing::exported;

class DeformableRun : public ::testing::Test {
 protected:
  static constexpr int kIterations = 200;  // 1/200 of the published run: it warms up until 15

  static DeformableConfig small() {
    DeformableConfig config;
    config.net_layers = 3;
    config.net_width = 16;
    config.densify_interval = 10;
    config.position_rate_scale = 1;  // as large as the scene
    return config;
  }
  std::unique_ptr<Backbone> make(const DeformableConfig& config, int iterations = kIterations, std::size_t cap = 400) {
    return make_deformable({scene_, threads_, 3, iterations, cap}, config);
  }
  std::vector<float> picture_at(Backbone& backbone, float time) const {
    const View& view = scene_.train[0];
    std::vector<float> color(view.color.size());
    backbone.render(view.camera, time, std::nullopt, color);
    return color;
  }

  Threads threads_{2};
  Scene scene_ = testing::moving_scene(threads_);
};

TEST_F(DeformableRun, nothing_moves_until_the_warm_up_ends) {
  const auto backbone = make(small());
  testing::train(*backbone, scene_, 1, 14);
  EXPECT_EQ(picture_at(*backbone, 0), picture_at(*backbone, 1));
  const test::TemporaryFolder folder;
  testing::save_state(*backbone, folder / "before");
  backbone->train_step(15, testing::view_at(scene_, 15));
  EXPECT_NE(picture_at(*backbone, 0), picture_at(*backbone, 1));
  testing::save_state(*backbone, folder / "after");
  const std::vector<float> before = ArchiveReader(folder / "before").floats("deformation.values"),
                           after = ArchiveReader(folder / "after").floats("deformation.values");
  EXPECT_EQ(before, initial_deformation(
                        [] {
                          DeformationShape shape;
                          shape.layers = 3;
                          shape.width = 16;
                          return shape;
                        }(),
                        RandomStream(3, 0, RandomPurpose::net_parameters)));
  // Adam's first step has the length of the learning rate, whatever the gradient. The rate is that of iteration 15 of
  // the run, although it is the net's first step.
  double largest = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    largest = std::max(largest, static_cast<double>(std::abs(after[i] - before[i])));
  }
  EXPECT_NEAR(largest, 8e-4 * std::pow(1.6e-6 / 8e-4, 15.0 / kIterations), 1e-6);
}

TEST_F(DeformableRun, a_scored_view_is_drawn_at_its_own_time) {
  // Unlike the release, which draws all scored views at the time of the view being trained on.
  const auto backbone = make(small());
  testing::train(*backbone, scene_, 1, 60);
  for (const std::size_t v : {std::size_t{0}, scene_.train.size() - 1}) {
    const View& view = scene_.train[v];
    std::vector<float> at_its_time(view.color.size()), at_another(view.color.size());
    backbone->render(view.camera, view.time, std::nullopt, at_its_time);
    backbone->render(view.camera, scene_.train[5].time, std::nullopt, at_another);
    const ScoredView scored = backbone->rasterizer_hook().render_for_score(v);
    EXPECT_TRUE(std::ranges::equal(scored.color, at_its_time));
    EXPECT_FALSE(std::ranges::equal(scored.color, at_another));
  }
}

TEST_F(DeformableRun, a_model_of_the_warm_up_is_drawn_without_motion) {
  const auto trained = make(small());
  const auto imported = [&] {
    const test::TemporaryFolder folder;
    trained->export_model(folder.path());
    auto read = make(small());
    read->import_model(folder.path());
    return read;
  };
  testing::train(*trained, scene_, 1, 14);
  const auto early = imported();
  EXPECT_EQ(picture_at(*early, 0), picture_at(*early, 1));
  testing::train(*trained, scene_, 15, 20);
  const auto late = imported();
  EXPECT_NE(picture_at(*late, 0), picture_at(*late, 1));
}

TEST_F(DeformableRun, gradients_are_those_of_the_moved_gaussians) {
  const auto trained = make(small());
  testing::train(*trained, scene_, 1, 60);
  trained->finish();
  const test::TemporaryFolder folder;
  trained->export_model(folder.path());
  const SplatCloud cloud = read_splat_ply(folder / "point_cloud.ply");
  const std::vector<float> net = ArchiveReader(folder / "parameters.bin").floats("deformation");
  DeformableConfig config = small();
  config.is_blender = false;
  config.time_noise = 0;
  config.densify_from = 40000;
  config.sh_degree = 0;
  const auto backbone = make(config);
  backbone->import_model(folder.path());
  testing::NeverSteps never;
  backbone->set_hooks(nullptr, &never);
  const View& view = scene_.train[3];
  const double loss = backbone->train_step(100, view);
  testing::save_state(*backbone, folder / "state");
  const ArchiveReader state(folder / "state");

  DeformationShape shape;
  shape.layers = 3;
  shape.width = 16;
  DeformationField field(shape, threads_);
  std::vector<float> scales(cloud.log_scales.size()), opacities(cloud.size());
  exponentials(cloud.log_scales, scales, threads_);
  sigmoids(cloud.logit_opacities, opacities, threads_);
  SplatCloud moved = cloud;
  std::vector<float> moved_scales(scales.size());
  const GaussianPlaces<const float> at{cloud.means, scales, cloud.rotations};
  field.forward(net, at, view.time, {moved.means, moved_scales, moved.rotations}, true);
  const auto drawn = testing::gradients_of_view(moved, moved_scales, opacities, view, {}, 0.8f, 0.2f, threads_);
  EXPECT_NEAR(loss, drawn.loss, 1e-6);
  std::vector<float> means(cloud.means.size()), of_scales(scales.size()), rotations(cloud.rotations.size()),
      of_net(net.size());
  field.backward(net, at, {drawn.means, drawn.scales, drawn.rotations}, {means, of_scales, rotations}, of_net);
  const auto expect_same = [&](const char* group, const std::vector<float>& expected) {
    testing::expect_close(state.floats(std::string(group) + ".gradients"), {expected.begin(), expected.end()}, 1e-4);
  };
  expect_same("xyz", means);
  expect_same("scaling", of_scales);
  expect_same("rotation", rotations);
  expect_same("deformation", of_net);
  EXPECT_EQ(means, drawn.means) << "no gradient of a mean goes through the net";
}

TEST_F(DeformableRun, decides_by_the_published_rules_on_what_is_canonical) {
  scene_.extent = 1;  // so that some Gaussians are larger than 0.1 of it
  DensityRecorder recorder;
  const auto backbone = make(small(), kIterations, 600);
  backbone->set_hooks(&recorder, nullptr);
  std::size_t growing = 0, faint = 0, large = 0, compared = 0;
  for (int i = 1; i <= kIterations; ++i) {
    const std::size_t before = recorder.events.size();
    const SplatCloud cloud = i == 60 ? exported(*backbone) : SplatCloud{};
    backbone->train_step(i, testing::view_at(scene_, i));
    if (i == 60) {
      // The canonical scales (nearly those before this iteration's step), not the deformed ones that are drawn.
      for (std::size_t k = 0; k < cloud.size(); ++k, ++compared) {
        const float scale = std::exp(*std::max_element(&cloud.log_scales[3 * k], &cloud.log_scales[3 * k] + 3));
        ASSERT_NEAR(recorder.events.at(before).max_scales[k], scale, 0.02f * scale);
      }
    }
  }
  std::set<int> expected, growths;
  for (int i = 10; i < 75; i += 10) expected.insert(i);  // iterations 500 to 15 000 of 40 000
  for (const DensityEvent& e : recorder.events) {
    if (e.growth) growths.insert(e.iteration);
    for (std::size_t i = 0; i < e.clone.size(); ++i) {
      const bool moves = e.gradients_abs[i] >= 7e-4f;
      EXPECT_EQ(e.clone[i] != 0, moves && e.max_scales[i] <= 0.01f);
      EXPECT_EQ(e.split[i] != 0, moves && e.max_scales[i] > 0.01f);
      growing += moves;
    }
    for (std::size_t i = 0; i < e.remove.size(); ++i) {
      // In short runs opacities are reset at every fifth growth at most.
      const bool is_faint = e.opacities[i]<0.005f, is_large = e.max_scales[i]> 0.1f && e.iteration > 50;
      EXPECT_EQ(e.remove[i] != 0, is_faint || is_large);
      faint += is_faint;
      large += is_large;
    }
  }
  EXPECT_EQ(growths, expected);
  EXPECT_GT(growing, 10u);
  EXPECT_GT(large, 0u);
  EXPECT_GT(compared, 0u);
}

TEST_F(DeformableRun, positions_step_at_a_rate_that_does_not_know_the_scene) {
  const auto first_step = [&](float extent, int iteration) {
    scene_.extent = extent;
    DeformableConfig config = small();
    config.position_rate_scale = DeformableConfig().position_rate_scale;
    config.densify_from = 40000;
    const auto backbone = make(config);
    const std::vector<float> before = exported(*backbone).means;
    backbone->train_step(iteration, scene_.train[0]);
    const std::vector<float> after = exported(*backbone).means;
    float largest = 0;
    for (std::size_t i = 0; i < before.size(); ++i) largest = std::max(largest, std::abs(after[i] - before[i]));
    return static_cast<double>(largest);
  };
  EXPECT_NEAR(first_step(1, 1), first_step(50, 1), 1e-6);
  EXPECT_NEAR(first_step(1, 1), 5 * 1.6e-4 * std::pow(0.01, 1 / 150.0), 1e-6);
  EXPECT_NEAR(first_step(1, 150), 8e-6, 2e-7) << "the end of the rates, 30 000 of 40 000";
  EXPECT_NEAR(first_step(1, 190), 8e-6, 2e-7) << "and after it";
}

TEST_F(DeformableRun, noise_of_times_falls_to_nothing_and_synthetic_scenes_have_none) {
  EXPECT_NEAR(mean_time_interval(scene_.train), 1.0 / (static_cast<double>(scene_.train.size()) - 1), 1e-6);
  const DeformableConfig config;
  double sum = 0, squares = 0;
  constexpr int kCount = 4000;
  for (int seed = 0; seed < kCount; ++seed) {
    const double noise = smoothing_noise(config, 0.05, 50, 100, static_cast<std::uint64_t>(seed));
    sum += noise;
    squares += noise * noise;
  }
  constexpr double kExpected = 0.1 * 0.05 * 0.5;
  EXPECT_NEAR(sum / kCount, 0, 4 * kExpected / std::sqrt(kCount));
  EXPECT_NEAR(std::sqrt(squares / kCount), kExpected, 0.05 * kExpected);
  EXPECT_EQ(smoothing_noise(config, 0.05, 100, 100, 1), 0);
  EXPECT_EQ(smoothing_noise(config, 0.05, 150, 100, 1), 0);

  const auto bytes = [&](bool blender, double noise) {
    DeformableConfig with = small();
    with.is_blender = blender;
    with.time_noise = noise;
    const auto backbone = make(with);
    testing::train(*backbone, scene_, 1, 20);
    return testing::model_bytes(*backbone);
  };
  EXPECT_EQ(bytes(true, 0.1), bytes(true, 0));
  EXPECT_NE(bytes(false, 0.1), bytes(false, 0));
}

TEST_F(DeformableRun, an_empty_view_shows_the_background_of_the_scene) {
  testing::expect_background_of_the_scene(
      [&](const Scene& scene) {
        return make_deformable({scene, threads_, 3, kIterations, 0}, small());
      },
      scene_);
}

TEST_F(DeformableRun, resume_is_exact) {
  testing::StepsEveryThird third;
  testing::expect_exact_resume([&] { return make(small(), 100); }, scene_, 60, {5, 15, 44}, &third);
}

TEST_F(DeformableRun, a_hook_says_how_far_the_net_steps) {
  DeformableConfig config = small();
  config.warm_up = 0;
  testing::expect_rates_times_factor(*make(config, 100), scene_, "deformation", "xyz");
}

TEST_F(DeformableRun, threads_do_not_change_the_bytes) {
  DeformableConfig config = small();
  config.is_6dof = config.is_blender = true;
  testing::expect_same_bytes_for_any_threads(
      [&](const Threads& threads) {
        return make_deformable({scene_, threads, 3, 100, 600}, config);
      },
      scene_, 60);
}

TEST_F(DeformableRun, models_are_read_back_and_the_cap_holds) {
  const auto backbone = make(small(), kIterations, 160);
  testing::train(*backbone, scene_, 1, 80);
  backbone->finish();
  EXPECT_LE(backbone->primitives(), 160u);
  const test::TemporaryFolder folder;
  const std::uint64_t bytes = backbone->export_model(folder.path());
  EXPECT_EQ(bytes, std::filesystem::file_size(folder / "point_cloud.ply") +
                       std::filesystem::file_size(folder / "parameters.bin"));
  const auto read = make(small());
  read->import_model(folder.path());
  EXPECT_EQ(testing::model_bytes(*read), testing::model_bytes(*backbone));
  EXPECT_NE(picture_at(*read, 0.3f), picture_at(*read, 0.9f));

  DeformableConfig other = small();
  other.net_width = 8;
  test::expect_contains(test::input_error_of([&] { make(other)->import_model(folder.path()); }), "deformation");
}

TEST_F(DeformableRun, memory_of_the_net_is_estimated) {
  EXPECT_GE(make({}, 100)->bytes_per_primitive(), gaussian_memory_bytes() + 8 * 256 * sizeof(float));
}

/// PSNR of the mean squared error over the views, each drawn at its own time.
double psnr_of(Backbone& backbone, const std::vector<View>& views) {
  double sum = 0, count = 0;
  for (const View& view : views) {
    std::vector<float> color(view.color.size());
    backbone.render(view.camera, view.time, std::nullopt, color);
    for (std::size_t p = 0; p < color.size(); ++p) {
      const double error = static_cast<double>(color[p]) - view.color[p] / 255.0;
      sum += error * error;
    }
    count += static_cast<double>(color.size());
  }
  return -10 * std::log10(sum / count);
}

TEST_F(DeformableRun, learns_motion_that_still_gaussians_cannot_show) {
  DeformableConfig config = small();
  config.net_width = 32;
  config.is_blender = true;
  config.densify_interval = 50;
  const auto psnr = [&](int warm_up) {
    DeformableConfig with = config;
    with.warm_up = warm_up;
    const auto backbone = make(with, 500, 600);
    testing::train(*backbone, scene_, 1, 500);
    backbone->finish();
    return psnr_of(*backbone, scene_.test);
  };
  const double moving = psnr(3000), still = psnr(40001);
  EXPECT_GT(moving, still + 0.8) << still;
  EXPECT_GT(moving, 19.0);
}

TEST_F(DeformableRun, a_scene_without_times_is_refused_in_one_line) {
  for (View& view : scene_.train) view.time = 0;
  const std::string message = test::input_error_of([&] { deformable_3dgs_entry().require_trainable(scene_); });
  test::expect_contains(message, "all 21 training views have the same time");
  test::expect_contains(message, "--frame-times");
}

TEST_F(DeformableRun, computed_pictures_choose_the_time_net_unless_told) {
  const auto is_blender = [&](bool synthetic, const nlohmann::json& constants) {
    scene_.synthetic = synthetic;
    return deformable_3dgs_entry().make({scene_, threads_, 3, 100, 0}, constants)->config()["is_blender"] == true;
  };
  EXPECT_TRUE(is_blender(true, nlohmann::json::object()));
  EXPECT_FALSE(is_blender(false, nlohmann::json::object()));
  EXPECT_FALSE(is_blender(true, {{"is_blender", false}}));
}

TEST(DeformableConfig, broken_ones_are_told_in_one_line) {
  const auto error = [](const nlohmann::json& json) {
    return test::input_error_of([&] { deformable_config_from_json(json); });
  };
  test::expect_contains(error({{"warmup", 3}}), "unknown key 'warmup'");
  test::expect_contains(error({{"warm_up", -1}}), "deformable-3dgs: warm_up must be at least 0");
  test::expect_contains(error({{"net_width", 0}}), "net_width must be 1 to 4096");
  test::expect_contains(error({{"net_layers", 65}}), "net_layers must be 1 to 64");
  test::expect_contains(error({{"deform_rate_final", 0}}), "deform rates must be above 0");
  test::expect_contains(error({{"time_noise_until", 0}}), "time_noise_until");
  test::expect_contains(error({{"time_noise", -0.1}}), "time_noise must be at least 0");
  test::expect_contains(error({{"sh_degree", 4}}), "deformable-3dgs: sh_degree");
  EXPECT_FALSE(to_json(DeformableConfig{}).contains("published_iterations"));
}

}  // namespace
}  // namespace splatboost

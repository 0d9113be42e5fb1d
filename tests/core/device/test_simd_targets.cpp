// SPDX-License-Identifier: Apache-2.0
// Every instruction set that this machine can run, from AVX-512 down to the portable code, against the reference. The
// vector width determines how a tile's rows are split, so each width is a different code path.
#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include <hwy/targets.h>

#include "reference/photometric.h"
#include "reference/rasterizer.h"
#include "reference/training.h"
#include "splatboost/adam.h"
#include "splatboost/errors.h"
#include "splatboost/instruction_set.h"
#include "splatboost/photometric.h"
#include "splatboost/rasterizer.h"
#include "support/compare.h"
#include "support/instruction_sets.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

using reference::Input;

TEST(InstructionSets, CanBeChosen) {
  const RestoreTargets restore;
  use_instruction_set(InstructionSet::best);
  const std::string best = instruction_set_name();
  use_instruction_set(InstructionSet::portable);
  EXPECT_EQ(instruction_set_name().find("AVX"), std::string::npos);
  for (const InstructionSet set : {InstructionSet::avx512, InstructionSet::avx2}) {
    try {
      use_instruction_set(set);
    } catch (const ArgumentError&) {
      continue;  // not on this machine
    }
    EXPECT_NE(instruction_set_name().find(set == InstructionSet::avx2 ? "AVX2" : "AVX3"), std::string::npos);
  }
  use_instruction_set(InstructionSet::best);
  EXPECT_EQ(instruction_set_name(), best);
}

TEST(SimdTargets, RasterizerAgreesWithTheWitness) {
  const Camera camera = oblique_camera(45, 35);
  for (const bool compact : {false, true}) {
    const SceneData scene = random_scene(camera, {.sh_degree = 1, .features = 2, .opacity_high = 1}, compact ? 71 : 72);
    RasterOptions options;
    options.background = {0.2f, 0.5f, 0.1f};
    options.box = compact ? BoxPolicy::ellipse : BoxPolicy::square;
    options.beta = 0.5f;
    const auto exact_camera = reference_camera(camera);
    const auto exact_options = reference_options(options);
    const auto exact_scene = scene.reference();
    const auto expected = reference::render(exact_scene, exact_camera, exact_options);
    EXPECT_TRUE(are_few(count_nonzero(expected.uncertain), expected.uncertain.size(), 0.03));
    const ImageGradientData weights(camera, 2, 73, expected.uncertain);
    const auto exact = [&](Input input) {
      return reference::gradient(exact_scene, exact_camera, exact_options, weights.reference(), input);
    };
    const auto means = exact(Input::means);
    const auto scales = exact(Input::scales);
    const auto opacities = exact(Input::opacities);
    const auto features = exact(Input::features);
    const auto screen = exact(Input::screen_means);
    std::vector<std::uint8_t> flagged;
    for (const std::uint8_t uncertain : expected.uncertain)
      flagged.push_back(uncertain == 0 && flagged.size() % 3 != 0 ? 1 : 0);
    const auto counts = reference::count_flagged(exact_scene, exact_camera, exact_options, flagged);

    for_each_target([&] {
      Threads threads(2);
      Rasterizer rasterizer(threads);
      ImageData images(camera, 2);
      rasterizer.forward(camera, scene.view(), options, images.view());
      EXPECT_TRUE(is_close(images.color, expected.color, kImageTolerance, expected.uncertain));
      EXPECT_TRUE(is_close(images.features, expected.features, kImageTolerance, expected.uncertain));
      EXPECT_TRUE(is_close(images.inverse_depth, expected.inverse_depth, kImageTolerance, expected.uncertain));
      EXPECT_TRUE(is_close(images.alpha, expected.alpha, kImageTolerance, expected.uncertain));
      GradientData gradients(scene);
      rasterizer.backward(scene.view(), weights.view(), gradients.view());
      EXPECT_TRUE(is_close(gradients.means, means.sum, kGradientTolerance)) << "means";
      EXPECT_TRUE(is_close(gradients.scales, scales.sum, kGradientTolerance)) << "scales";
      EXPECT_TRUE(is_close(gradients.opacities, opacities.sum, kGradientTolerance)) << "opacities";
      EXPECT_TRUE(is_close(gradients.features, features.sum, kGradientTolerance)) << "features";
      EXPECT_TRUE(is_close(gradients.screen_means, screen.sum, kGradientTolerance)) << "screen_means";
      EXPECT_TRUE(is_close(gradients.screen_means_abs, screen.absolute_sum, kGradientTolerance)) << "screen_means_abs";
      std::vector<std::int32_t> counted(scene.count, 0);
      rasterizer.count_flagged(flagged, counted);
      for (std::size_t i = 0; i < scene.count; ++i) EXPECT_EQ(counted[i], counts[i]) << i;
    });
  }
}

TEST(SimdTargets, PhotometricAgreesWithTheWitness) {
  Numbers random(4);
  reference::ImagePair pair;
  pair.width = 39;
  pair.height = 22;
  std::vector<float> render;
  std::vector<std::uint8_t> truth;
  for (int k = 0; k < 3 * 39 * 22; ++k) {
    render.push_back(random.real(0, 1));
    truth.push_back(static_cast<std::uint8_t>(random.bits() % 256));
    pair.render.push_back(static_cast<double>(render.back()));
    pair.truth.push_back(truth.back() / 255.0);
  }
  const auto exact = reference::photometric(pair, 0.2f);
  const auto slopes = reference::photometric_gradient(pair, 0.2f);
  for_each_target([&] {
    Threads threads(2);
    Photometric photometric(threads);
    std::vector<float> gradient(render.size());
    const PhotometricLoss loss = photometric.evaluate(render, {39, 22, truth, {}}, 0.2f, gradient);
    EXPECT_NEAR(loss.total, exact.total, 5e-6);
    EXPECT_TRUE(is_close(gradient, slopes, {.relative = 2e-4, .scale = 1e-4, .absolute = 0, .l2 = 5e-5}));
  });
}

TEST(SimdTargets, AdamAgreesWithTheWitness) {
  Numbers random(5);
  std::vector<float> start;
  std::vector<float> slopes;
  for (int i = 0; i < 1003; ++i) {
    start.push_back(random.real(-1, 1));
    slopes.push_back(random.real(-1, 1));
  }
  reference::AdamState exact{{start.begin(), start.end()}, std::vector<double>(1003), std::vector<double>(1003)};
  for (int step = 1; step <= 3; ++step) {
    reference::adam_step(exact, {slopes.begin(), slopes.end()}, step, 0.01f, 0.9f, 0.999f, 1e-15f);
  }
  for_each_target([&] {
    Threads threads(2);
    std::vector<float> values = start;
    std::vector<float> first(1003, 0);
    std::vector<float> second(1003, 0);
    for (int step = 1; step <= 3; ++step) {
      std::vector<float> gradients = slopes;
      adam_step(values, gradients, first, second, step, {.learning_rate = 0.01f}, threads);
    }
    EXPECT_TRUE(is_close(values, exact.values, {.relative = 1e-6, .scale = 0, .absolute = 1e-6, .l2 = 1e-6}));
  });
}

}  // namespace
}  // namespace splatboost::test

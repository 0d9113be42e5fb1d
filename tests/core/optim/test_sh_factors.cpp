// SPDX-License-Identifier: Apache-2.0
// Gradients of higher SH bands as factors: the bits of a backward pass that writes the gradients themselves.
#include "splatboost/sh_factors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <vector>

#include "splatboost/constants.h"
#include "splatboost/errors.h"
#include "splatboost/rasterizer.h"
#include "support/instruction_sets.h"
#include "support/looking_camera.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

using testing::camera_looking_at_origin;

constexpr std::size_t kCount = 83;  // not a multiple of a vector's lanes
constexpr int kRows = 15;
constexpr std::size_t kStride = 3 * kRows;
constexpr int kWidth = 64, kHeight = 48;

/// Gaussians of which some are out of sight, some behind the camera, and one is at the centre of a camera.
struct Model {
  std::vector<float> means, scales, rotations, opacities, dc, rest;
  Gaussians gaussians;

  explicit Model(int degree) {
    Numbers random(5);
    for (std::size_t i = 0; i < kCount; ++i) {
      const float spread = i % 5 == 0 ? 6.0f : 1.0f;
      for (int c = 0; c < 3; ++c) means.push_back(spread * random.real(-1, 1));
      for (int c = 0; c < 3; ++c) scales.push_back(random.real(0.03f, 0.2f));
      for (int c = 0; c < 4; ++c) rotations.push_back(random.real(-1, 1));
      opacities.push_back(random.real(0.1f, 0.9f));
      for (int c = 0; c < 3; ++c) dc.push_back(random.real(-1.5f, 1.5f));  // some colours are clamped at zero
      for (std::size_t k = 0; k < kStride; ++k) rest.push_back(random.real(-0.3f, 0.3f));
    }
    gaussians.count = kCount;
    gaussians.means = means;
    gaussians.scales = scales;
    gaussians.rotations = rotations;
    gaussians.opacities = opacities;
    gaussians.sh_dc = dc;
    gaussians.sh_rest = rest;
    gaussians.sh_rest_rows = kRows;
    gaussians.sh_degree = degree;
  }
};

Camera camera(int view) {
  const double angle = 0.9 * view;
  return camera_looking_at_origin({4 * std::cos(angle), 0.3 * view, 4 * std::sin(angle)}, kWidth, kHeight);
}

/// One backward pass, with a gradient of the image that depends on the view.
void backward(Rasterizer& rasterizer, const Gaussians& gaussians, int view, GaussianGradients out) {
  std::vector<float> image(3 * kWidth * kHeight), gradient;
  RasterImages images;
  images.color = image;
  rasterizer.forward(camera(view), gaussians, RasterOptions{}, images);
  Numbers random(10 + static_cast<unsigned>(view));
  for (std::size_t i = 0; i < image.size(); ++i) gradient.push_back(random.real(-1, 1));
  RasterImageGradients of_images;
  of_images.color = gradient;
  out.mode = GradientMode::accumulate;
  rasterizer.backward(gaussians, of_images, out);
}

struct Passes {
  std::vector<float> gradients, means_direct, means_factored;
  std::vector<std::vector<float>> factors;
  std::vector<ShFactors> views;

  /// Views of degree 3, 1, 0 and 2, so that gradients of some coefficients are sums of fewer views.
  explicit Passes(const Threads& threads)
      : gradients(kStride * kCount), means_direct(3 * kCount), means_factored(3 * kCount) {
    Rasterizer rasterizer(threads);
    const int degrees[] = {3, 1, 0, 2};
    for (int view = 0; view < 4; ++view) {
      const Model model(degrees[view]);
      GaussianGradients direct, factored;
      direct.means = means_direct;
      direct.sh_rest = gradients;
      backward(rasterizer, model.gaussians, view, direct);
      factors.emplace_back(kShFactors * kCount, 9.0f);  // overwritten in the mode that accumulates too
      factored.means = means_factored;
      factored.sh_factors = factors.back();
      backward(rasterizer, model.gaussians, view, factored);
      views.push_back({{}, degrees[view]});
    }
    for (std::size_t v = 0; v < views.size(); ++v) views[v].rows = factors[v];
  }
};

TEST(ShFactors, SumToTheGradientsOfTheBackwardPassesBitByBit) {
  Threads threads(2);
  for_each_target([&] {
    const Passes passes(threads);
    std::vector<float> sum(kStride * kCount, 7.0f);
    sum_sh_gradients(passes.views, kRows, sum, threads);
    EXPECT_EQ(std::memcmp(passes.means_direct.data(), passes.means_factored.data(), 3 * kCount * sizeof(float)), 0);
    std::size_t zeros = 0, in_sight = 0;
    for (std::size_t i = 0; i < sum.size(); ++i) {
      ASSERT_EQ(sum[i], passes.gradients[i]) << i;
      zeros += sum[i] == 0 ? 1 : 0;
      in_sight += sum[i] != 0 ? 1 : 0;
    }
    EXPECT_GT(zeros, kStride) << "some Gaussians must be out of sight";
    EXPECT_GT(in_sight, 20 * kStride);
  });
}

TEST(ShFactors, StepAsAdamDoesWithTheGradients) {
  Threads threads(2);
  for_each_target([&] {
    const Passes passes(threads);
    Numbers random(3);
    std::vector<float> values, first, second;
    for (std::size_t i = 0; i < kStride * kCount; ++i) {
      values.push_back(random.real(-1, 1));
      first.push_back(random.real(-0.1f, 0.1f));
      second.push_back(random.real(0, 0.1f));
    }
    std::vector<float> values_sh = values, first_sh = first, second_sh = second, gradients = passes.gradients;
    const AdamOptions options{.learning_rate = 0.01f};
    adam_step(values, gradients, first, second, 5, options, threads);
    adam_step_sh(values_sh, kRows, passes.views, first_sh, second_sh, 5, options, threads);
    EXPECT_EQ(values_sh, values);
    EXPECT_EQ(first_sh, first);
    EXPECT_EQ(second_sh, second);
  });
}

TEST(ShFactors, OfNoViewsAreZero) {
  Threads threads(1);
  std::vector<float> sum(2 * kStride, 1.0f);
  sum_sh_gradients({}, kRows, sum, threads);
  EXPECT_EQ(sum, std::vector<float>(2 * kStride));
}

TEST(ShFactors, RefuseWhatDoesNotFit) {
  Threads threads(1);
  std::vector<float> rows(2 * kShFactors), values(2 * kStride), other(kStride);
  const ShFactors view{rows, 3}, lower{rows, 2}, shorter{std::span(rows).first(kShFactors), 3};
  EXPECT_NO_THROW(sum_sh_gradients({&view, 1}, kRows, values, threads));
  EXPECT_NO_THROW(sum_sh_gradients({&lower, 1}, 8, std::span(values).first(2 * 24), threads));
  EXPECT_THROW(sum_sh_gradients({&view, 1}, 8, std::span(values).first(2 * 24), threads), ArgumentError);
  EXPECT_THROW(sum_sh_gradients({&shorter, 1}, kRows, values, threads), ArgumentError);
  EXPECT_THROW(sum_sh_gradients({}, 0, {}, threads), ArgumentError);
  EXPECT_THROW(sum_sh_gradients({}, 16, {}, threads), ArgumentError);
  EXPECT_THROW(adam_step_sh(values, kRows, {&view, 1}, other, values, 1, {}, threads), ArgumentError);
  EXPECT_THROW(adam_step_sh(values, kRows, {&view, 1}, values, values, 0, {}, threads), ArgumentError);

  const Model model(3);
  Rasterizer rasterizer(threads);
  GaussianGradients out;
  out.sh_factors = rows;
  EXPECT_THROW(backward(rasterizer, model.gaussians, 0, out), ArgumentError);
  std::vector<float> factors(kShFactors * kCount), rest(kStride * kCount);
  out.sh_factors = factors;
  EXPECT_NO_THROW(backward(rasterizer, model.gaussians, 0, out));
  out.sh_rest = rest;
  EXPECT_THROW(backward(rasterizer, model.gaussians, 0, out), ArgumentError) << "one or the other";
}

}  // namespace
}  // namespace splatboost::test

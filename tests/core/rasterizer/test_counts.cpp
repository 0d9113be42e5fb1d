// SPDX-License-Identifier: Apache-2.0
// Flagged-pixel counts: integers, equal to the reference's away from thresholds.
#include <gtest/gtest.h>

#include <limits>
#include <numeric>
#include <vector>

#include "reference/rasterizer.h"
#include "splatboost/rasterizer.h"
#include "support/compare.h"
#include "support/scenes.h"
#include "support/tested_rasterizer.h"

namespace splatboost::test {
namespace {

struct CountsCase {
  BoxPolicy box;
  float beta;
  double opacity_high;
};

class Counts : public ::testing::TestWithParam<CountsCase> {
 protected:
  Counts() {
    options.box = GetParam().box;
    options.beta = GetParam().beta;
    SceneSpec spec;
    spec.count = 300;
    spec.colors = true;
    spec.largest = 9;
    spec.opacity_high = GetParam().opacity_high;
    scene = random_scene(camera, spec, 17);
    images.emplace_back(camera, 0);
    rasterizer.forward(camera, scene.view(), options, images[0].view());
    expected = reference::render(scene.reference(), reference_camera(camera), reference_options(options));
  }

  std::vector<std::int64_t> exact(const std::vector<std::uint8_t>& flagged) const {
    return reference::count_flagged(scene.reference(), reference_camera(camera), reference_options(options), flagged);
  }

  Camera camera = oblique_camera(131, 90);
  std::size_t pixels = 131 * 90;
  RasterOptions options;
  SceneData scene;
  Threads threads{2};
  Rasterizer rasterizer{threads};
  std::vector<ImageData> images;
  reference::Rendering<double> expected;
};

TEST_P(Counts, EqualTheWitnessAwayFromThresholds) {
  EXPECT_TRUE(are_few(count_nonzero(expected.uncertain), pixels, 0.05));
  Numbers random(5);
  for (const double share : {0.02, 0.5, 1.0}) {
    std::vector<std::uint8_t> flagged(pixels);
    for (std::size_t p = 0; p < pixels; ++p)
      flagged[p] = expected.uncertain[p] == 0 && random.uniform(0, 1) < share ? 1 : 0;
    std::vector<std::int32_t> counts(scene.count, 0);
    rasterizer.count_flagged(flagged, counts);
    const auto truth = exact(flagged);
    for (std::size_t i = 0; i < scene.count; ++i) ASSERT_EQ(counts[i], truth[i]) << i;
    EXPECT_GT(std::accumulate(counts.begin(), counts.end(), 0), 0);
  }
}

TEST_P(Counts, AddUpOverCallsAndOverDisjointMasks) {
  Numbers random(6);
  std::vector<std::uint8_t> some(pixels);
  std::vector<std::uint8_t> others(pixels);
  for (std::size_t p = 0; p < pixels; ++p) (random.uniform(0, 1) < 0.3 ? some : others)[p] = 1;
  const std::vector<std::uint8_t> all(pixels, 1);
  std::vector<std::int32_t> parts(scene.count, 7);
  rasterizer.count_flagged(some, parts);
  rasterizer.count_flagged(others, parts);
  std::vector<std::int32_t> whole(scene.count, 7);
  rasterizer.count_flagged(all, whole);
  EXPECT_EQ(parts, whole);
}

TEST_P(Counts, NothingFlaggedChangesNothing) {
  std::vector<std::int32_t> counts(scene.count, -3);
  rasterizer.count_flagged(std::vector<std::uint8_t>(pixels, 0), counts);
  EXPECT_EQ(counts, std::vector<std::int32_t>(scene.count, -3));
}

// The replay agrees with the image: some Gaussian is blended exactly where the image is not background.
TEST_P(Counts, AreZeroExactlyWhereThePictureIsEmpty) {
  for (std::size_t p = 0; p < pixels; p += 97) {
    std::vector<std::uint8_t> flagged(pixels, 0);
    flagged[p] = 255;
    std::vector<std::int32_t> counts(scene.count, 0);
    rasterizer.count_flagged(flagged, counts);
    const int blended = std::accumulate(counts.begin(), counts.end(), 0);
    EXPECT_EQ(blended > 0, images[0].alpha[p] > 0) << p;
    for (const std::int32_t count : counts) EXPECT_TRUE(count == 0 || count == 1);
  }
}

// A backward pass between forward and replay must not disturb it.
TEST_P(Counts, AreTheSameAfterABackwardPass) {
  const std::vector<std::uint8_t> all(pixels, 1);
  std::vector<std::int32_t> before(scene.count, 0);
  rasterizer.count_flagged(all, before);
  GradientData gradients(scene);
  const ImageGradientData weights(camera, 0, 3, {});
  rasterizer.backward(scene.view(), weights.view(), gradients.view());
  std::vector<std::int32_t> after(scene.count, 0);
  rasterizer.count_flagged(all, after);
  EXPECT_EQ(before, after);
}

INSTANTIATE_TEST_SUITE_P(Boxes, Counts,
                         ::testing::Values(CountsCase{BoxPolicy::square, 1, 0.95},
                                           CountsCase{BoxPolicy::ellipse, 1, 0.95},
                                           CountsCase{BoxPolicy::ellipse, 0.5f, 0.95},
                                           CountsCase{BoxPolicy::ellipse, 1, 0.1}));

TEST(CountsKnown, OneSplatIsCountedWhereItReachesOneStep) {
  Camera camera;
  camera.width = 40;
  camera.height = 40;
  camera.fx = camera.fy = 1;
  SceneData scene;
  scene.count = 2;
  scene.means = {20.5f, 20.5f, 1, 20.5f, 20.5f, -1};
  for (int i = 0; i < 2; ++i) {
    for (const float v : {8.7f, 0.f, 0.f, 8.7f, 0.f, 0.f}) scene.covariances.push_back(v);
    scene.opacities.push_back(0.5f);
    for (int c = 0; c < 3; ++c) scene.colors.push_back(1);
  }
  Threads threads(1);
  Rasterizer rasterizer(threads);
  ImageData images(camera, 0);
  RasterOptions options;
  options.box = BoxPolicy::ellipse;
  rasterizer.forward(camera, scene.view(), options, images.view());
  // Variance 9: alpha ≥ 1/255 where dx² + dy² ≤ 18·ln(127.5) = 87.26. Count the lattice points.
  std::int32_t inside = 0;
  for (int dx = -20; dx <= 20; ++dx) {
    for (int dy = -20; dy <= 20; ++dy) inside += dx * dx + dy * dy <= 87 ? 1 : 0;
  }
  std::vector<std::int32_t> counts(2, 0);
  rasterizer.count_flagged(std::vector<std::uint8_t>(1600, 1), counts);
  EXPECT_EQ(counts[0], inside);
  EXPECT_EQ(counts[1], 0);
}

/// Splats of one opacity, one behind the other, each of which covers the only pixel completely.
struct OnePixel {
  OnePixel(int count, float opacity) {
    camera.width = camera.height = 1;
    camera.fx = camera.fy = 1;
    scene.count = static_cast<std::size_t>(count);
    for (int i = 0; i < count; ++i) {
      const float z = static_cast<float>(i + 1);
      for (const float v : {0.5f * z, 0.5f * z, z}) scene.means.push_back(v);
      for (const float v : {100.f, 0.f, 0.f, 100.f, 0.f, 0.f}) scene.covariances.push_back(v);
      scene.opacities.push_back(opacity);
      for (int c = 0; c < 3; ++c) scene.colors.push_back(1);
    }
    rasterizer.forward(camera, scene.view(), RasterOptions{}, images.emplace_back(camera, 0).view());
  }
  Camera camera;
  SceneData scene;
  Threads threads{1};
  Rasterizer rasterizer{threads};
  std::vector<ImageData> images;
};

TEST(CountsKnown, ASplatBehindASaturatedPixelIsNotCounted) {
  OnePixel stack(4, 0.97f);  // T: 0.03, 9e-4, 2.7e-5: the third would saturate, the fourth comes after
  Rasterizer& rasterizer = stack.rasterizer;
  std::vector<std::int32_t> counts(4, 0);
  rasterizer.count_flagged(std::vector<std::uint8_t>(1, 1), counts);
  EXPECT_EQ(counts, (std::vector<std::int32_t>{1, 1, 0, 0}));
}

TEST(CountsKnown, ASplatIsObservedWhereLittleLiesInFrontOfIt) {
  OnePixel stack(5, 0.3f);  // T before: 1, 0.7, 0.49, 0.34, 0.24
  Rasterizer& rasterizer = stack.rasterizer;
  std::vector<std::int32_t> counts(5, 0);
  rasterizer.count_observed(0.5f, counts);
  EXPECT_EQ(counts, (std::vector<std::int32_t>{1, 1, 0, 0, 0}));
  rasterizer.count_observed(0.3f, counts);
  EXPECT_EQ(counts, (std::vector<std::int32_t>{2, 2, 1, 1, 0}));
}

// Without a threshold all blended Gaussians are observed; with one, the counts never exceed those of blending.
TEST_P(Counts, ObservedAreThoseBlendedInFrontOfTheThreshold) {
  std::vector<std::int32_t> blended(scene.count, 0), observed(scene.count, 0), half(scene.count, 0);
  rasterizer.count_flagged(std::vector<std::uint8_t>(pixels, 1), blended);
  rasterizer.count_observed(0, observed);
  EXPECT_EQ(observed, blended);
  rasterizer.count_observed(0.5f, half);
  std::size_t fewer = 0;
  for (std::size_t i = 0; i < scene.count; ++i) {
    EXPECT_LE(half[i], blended[i]) << i;
    fewer += half[i] < blended[i] ? 1 : 0;
  }
  if (GetParam().opacity_high > 0.5) {
    EXPECT_GT(fewer, 10u);
  }
}

TEST(CountsKnown, WeightsAreOpacityTimesTransmittance) {
  OnePixel stack(5, 0.3f);  // T before: 1, 0.7, 0.49, 0.343, 0.2401
  Rasterizer& rasterizer = stack.rasterizer;
  std::vector<std::int32_t> weights(5, 1);
  rasterizer.add_weights(weights);
  EXPECT_EQ(weights, (std::vector<std::int32_t>{78, 55, 39, 27, 19}));  // 1 + 76.8, 53.76, 37.6, 26.3, 18.4
}

TEST(CountsKnown, SumsOfWeightsStopAtTheLargestNumber) {
  OnePixel stack(4, 0.3f);  // 77, 54, 38, 26
  Rasterizer& rasterizer = stack.rasterizer;
  constexpr std::int32_t most = std::numeric_limits<std::int32_t>::max();
  std::vector<std::int32_t> weights{most - 76, most - 54, most - 100, -30};
  rasterizer.add_weights(weights);
  EXPECT_EQ(weights, (std::vector<std::int32_t>{most, most, most - 62, -4}));
  rasterizer.add_weights(weights);
  EXPECT_EQ(weights, (std::vector<std::int32_t>{most, most, most - 24, 22}));
}

TEST_P(Counts, WeightsEqualTheWitness) {
  std::vector<std::int32_t> weights(scene.count, 0), blended(scene.count, 0);
  rasterizer.add_weights(weights);
  rasterizer.count_flagged(std::vector<std::uint8_t>(pixels, 1), blended);
  std::vector<std::uint8_t> certain;
  const auto truth =
      reference::blending_weights(scene.reference(), reference_camera(camera), reference_options(options), certain);
  const auto exact_counts = exact(std::vector<std::uint8_t>(pixels, 1));
  std::size_t compared = 0;
  for (std::size_t i = 0; i < scene.count; ++i) {
    // Tolerates pixels at a threshold and weights that round differently, which affect later weights slightly.
    EXPECT_NEAR(weights[i], static_cast<double>(truth[i]), 2 + 0.002 * blended[i]) << i;
    EXPECT_LE(weights[i], 256 * blended[i]) << i;
    compared += certain[i] != 0 && blended[i] == exact_counts[i] && weights[i] == truth[i] ? 1 : 0;
  }
  EXPECT_GT(compared, scene.count / 4) << "equal to the last unit where no rounding is doubtful";
}

}  // namespace
}  // namespace splatboost::test

// SPDX-License-Identifier: Apache-2.0
// The rasterizer against the double-precision reference: values, counts and the gradient of every input.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include "reference/rasterizer.h"
#include "splatboost/rasterizer.h"
#include "support/compare.h"
#include "support/scenes.h"
#include "support/tested_rasterizer.h"

namespace splatboost::test {
namespace {

using reference::Input;

struct Case {
  std::string name;
  int width = 48;
  int height = 32;
  SceneSpec scene;
  RasterOptions options;
  std::uint64_t seed = 1;
  double band = 0.03;   ///< fraction of pixels that may lie at a threshold
  double rounding = 1;  ///< factor on the gradients' tolerance
};

constexpr const char* kEdge = "principal_point_at_the_edge";

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

RasterOptions square() {
  RasterOptions options;
  options.background = {0.3f, 0.1f, 0.7f};
  return options;
}

RasterOptions ellipse(float beta) {
  RasterOptions options = square();
  options.box = BoxPolicy::ellipse;
  options.beta = beta;
  return options;
}

RasterOptions compensated(RasterOptions options) {
  options.compensate_opacity = true;
  return options;
}

std::vector<Case> cases() {
  std::vector<Case> all;
  for (int degree = 0; degree <= 3; ++degree) {
    all.push_back({"square_sh" + std::to_string(degree), 50, 37, {.sh_degree = degree}, square(), 10u + degree});
    all.push_back({"ellipse_sh" + std::to_string(degree), 37, 50, {.sh_degree = degree}, ellipse(1), 20u + degree});
    all.push_back({"compact_sh" + std::to_string(degree), 33, 17, {.sh_degree = degree}, ellipse(0.5f), 30u + degree});
  }
  all.push_back({"inactive_degrees", 32, 32, {.sh_degree = 1, .sh_rest_rows = 15}, square(), 40});
  all.push_back({"one_feature", 48, 32, {.sh_degree = 0, .features = 1}, square(), 41});
  all.push_back({"eight_features", 48, 32, {.sh_degree = 0, .features = 8}, ellipse(1), 42});
  all.push_back({"given_colors_and_covariances_square",
                 40,
                 40,
                 {.colors = true, .covariances = true, .features = 3},
                 square(),
                 43});
  all.push_back(
      {"given_colors_and_covariances_compact", 40, 40, {.colors = true, .covariances = true}, ellipse(0.5f), 44});
  all.push_back({"given_colors_with_scales", 40, 40, {.colors = true}, square(), 45});
  all.push_back({"sh_with_covariances", 40, 40, {.sh_degree = 2, .covariances = true}, ellipse(1), 46});
  all.push_back(
      {"compensated_square", 45, 30, {.sh_degree = 1, .smallest = 0.2, .largest = 3}, compensated(square()), 47});
  all.push_back(
      {"compensated_ellipse", 45, 30, {.sh_degree = 1, .smallest = 0.2, .largest = 3}, compensated(ellipse(1)), 48});
  all.push_back({"compensated_compact_covariances",
                 45,
                 30,
                 {.colors = true, .covariances = true, .smallest = 0.2, .largest = 3},
                 compensated(ellipse(0.5f)),
                 49});
  // Splats far smaller than a pixel, for which the compensation is at its lower limit.
  all.push_back(
      {"one_pixel_splats", 40, 24, {.count = 60, .sh_degree = 1, .smallest = 0.005, .largest = 0.2}, square(), 50});
  all.push_back({"one_pixel_splats_compensated",
                 40,
                 24,
                 {.count = 60, .sh_degree = 1, .smallest = 0.005, .largest = 0.4, .opacity_low = 0.6},
                 compensated(ellipse(1)),
                 51});
  // The 2D Mip filter.
  {
    RasterOptions options = compensated(ellipse(0.5f));
    options.low_pass = 0.1f;
    all.push_back({"mip_filter", 45, 30, {.sh_degree = 1, .smallest = 0.1, .largest = 3}, options, 69});
  }
  // Dropout scales up the opacities of the Gaussians that it keeps.
  all.push_back({"opacities_above_one_square",
                 45,
                 30,
                 {.sh_degree = 0, .smallest = 1, .largest = 6, .opacity_low = 0.8, .opacity_high = 1.25},
                 square(),
                 70,
                 0.06,
                 3});
  all.push_back({"opacities_above_one_compact",
                 45,
                 30,
                 {.sh_degree = 0, .smallest = 1, .largest = 6, .opacity_low = 0.8, .opacity_high = 1.25},
                 ellipse(0.5f),
                 71,
                 0.06,
                 3});
  // Alpha is clamped at 0.99 in their middle, and pixels saturate after a few. 1/(1 − alpha) amplifies rounding up to
  // 100 times.
  all.push_back({"saturated_square",
                 40,
                 40,
                 {.count = 60, .sh_degree = 1, .smallest = 4, .largest = 15, .opacity_low = 0.9, .opacity_high = 1},
                 square(),
                 52,
                 0.06,
                 3});
  all.push_back({"saturated_compact",
                 40,
                 40,
                 {.count = 60, .sh_degree = 1, .smallest = 4, .largest = 15, .opacity_low = 0.9, .opacity_high = 1},
                 ellipse(0.5f),
                 53,
                 0.06,
                 3});
  // Means far outside the image, with Gaussians wide enough to reach it: means are clamped to the field of view.
  all.push_back({"beyond_the_field_of_view",
                 40,
                 30,
                 {.count = 30, .sh_degree = 1, .smallest = 10, .largest = 40, .nearest = 0.3, .margin = 1.5},
                 square(),
                 54,
                 0.06});
  all.push_back({"beyond_the_field_of_view_compact",
                 40,
                 30,
                 {.count = 30, .sh_degree = 1, .smallest = 10, .largest = 40, .nearest = 0.3, .margin = 1.5},
                 ellipse(1),
                 55,
                 0.06});
  // Part of the image is beyond the field of view of a camera whose principal point is in its centre.
  all.push_back({kEdge,
                 40,
                 30,
                 {.count = 30, .sh_degree = 1, .smallest = 1, .largest = 12, .margin = 0.5},
                 ellipse(1),
                 72,
                 0.06});
  all.push_back(
      {"around_the_near_plane", 40, 30, {.count = 40, .sh_degree = 0, .nearest = 0.02, .farthest = 0.5}, square(), 56});
  all.push_back(
      {"single_pixel_image", 1, 1, {.count = 12, .sh_degree = 2, .smallest = 0.3, .largest = 3}, square(), 57, 0.5});
  all.push_back({"single_pixel_image_compact",
                 1,
                 1,
                 {.count = 12, .sh_degree = 2, .smallest = 0.3, .largest = 3},
                 ellipse(0.5f),
                 57,
                 0.5});
  all.push_back({"column_image", 1, 70, {.sh_degree = 0}, ellipse(1), 58, 0.06});
  all.push_back({"row_image", 70, 1, {.sh_degree = 0}, square(), 59, 0.06});
  all.push_back({"exact_tiles", 64, 16, {.sh_degree = 0}, ellipse(1), 60});
  all.push_back({"one_beyond_tiles", 65, 17, {.sh_degree = 0}, ellipse(0.5f), 61});
  all.push_back({"all_behind", 20, 20, {.count = 5, .sh_degree = 1, .behind = 1}, square(), 62});
  all.push_back({"all_off_screen",
                 20,
                 20,
                 {.count = 8, .sh_degree = 1, .smallest = 0.5, .largest = 1, .margin = 0, .behind = 0.5},
                 ellipse(1),
                 63});
  all.push_back({"faint",
                 48,
                 32,
                 {.count = 80, .sh_degree = 0, .opacity_low = 0.001, .opacity_high = 0.02},
                 ellipse(1),
                 64,
                 0.15});
  {
    RasterOptions options = square();
    options.low_pass = 0.1f;
    options.near_plane = 2.5f;
    all.push_back({"other_low_pass_and_near_plane", 48, 32, {.sh_degree = 0, .smallest = 0.2}, options, 65});
    options.low_pass = 0;
    options.box = BoxPolicy::ellipse;
    all.push_back({"no_low_pass", 48, 32, {.sh_degree = 0, .smallest = 1}, options, 66});
    options.compensate_opacity = true;  // without low-pass filter the ratio is 1
    all.push_back({"no_low_pass_compensated", 48, 32, {.sh_degree = 0, .smallest = 1}, options, 67});
  }
  all.push_back(
      {"hundreds", 60, 44, {.count = 300, .colors = true, .smallest = 0.5, .largest = 4}, ellipse(0.5f), 68, 0.12});
  return all;
}

/// The camera that a scene is made for.
Camera scene_camera(const Case& c) {
  Camera camera = oblique_camera(c.width, c.height);
  if (c.name == kEdge) camera.cx = 0;
  return camera;
}

Camera camera_of(const Case& c) {
  Camera camera = scene_camera(c);
  // One case has all Gaussians outside the image.
  if (c.name == "all_off_screen") camera.cx += 400;
  return camera;
}

SceneData scene_of(const Case& c) { return random_scene(scene_camera(c), c.scene, c.seed); }

class RasterizerReference : public ::testing::TestWithParam<Case> {};

TEST_P(RasterizerReference, ValuesAgree) {
  const Case& c = GetParam();
  const Camera camera = camera_of(c);
  const SceneData scene = scene_of(c);
  Threads threads(2);
  Rasterizer rasterizer(threads);
  ImageData images(camera, scene.features_per_gaussian);
  rasterizer.forward(camera, scene.view(), c.options, images.view());
  const auto expected = reference::render(scene.reference(), reference_camera(camera), reference_options(c.options));

  EXPECT_TRUE(are_few(count_nonzero(expected.uncertain), expected.uncertain.size(), c.band));
  EXPECT_TRUE(is_close(images.color, expected.color, kImageTolerance, expected.uncertain)) << "color";
  EXPECT_TRUE(is_close(images.features, expected.features, kImageTolerance, expected.uncertain)) << "features";
  EXPECT_TRUE(is_close(images.inverse_depth, expected.inverse_depth, kImageTolerance, expected.uncertain))
      << "inverse depth";
  EXPECT_TRUE(is_close(images.alpha, expected.alpha, kImageTolerance, expected.uncertain)) << "alpha";
}

TEST_P(RasterizerReference, VisibilityRadiiAndTileEntriesAgree) {
  const Case& c = GetParam();
  const Camera camera = camera_of(c);
  const SceneData scene = scene_of(c);
  Threads threads(2);
  Rasterizer rasterizer(threads);
  ImageData images(camera, scene.features_per_gaussian);
  rasterizer.forward(camera, scene.view(), c.options, images.view());
  const auto expected = reference::render(scene.reference(), reference_camera(camera), reference_options(c.options));

  ASSERT_EQ(rasterizer.visible().size(), scene.count);
  ASSERT_EQ(rasterizer.screen_radii().size(), scene.count);
  std::size_t visible = 0;
  std::size_t uncertain = 0;
  for (std::size_t i = 0; i < scene.count; ++i) {
    const bool is_visible = rasterizer.visible()[i] != 0;
    visible += is_visible ? 1 : 0;
    if (expected.listing_uncertain[i] != 0) {
      ++uncertain;
      continue;
    }
    EXPECT_EQ(is_visible, expected.visible[i] != 0) << i;
    EXPECT_GE(rasterizer.screen_radii()[i], expected.radii_low[i]) << i;
    EXPECT_LE(rasterizer.screen_radii()[i], expected.radii_high[i]) << i;
  }
  EXPECT_TRUE(are_few(uncertain, scene.count, 0.05));
  EXPECT_EQ(rasterizer.counts().visible, visible);
  const std::size_t entries = rasterizer.counts().tile_entries;
  EXPECT_LE(entries, expected.tile_entries + expected.uncertain_entries);
  EXPECT_GE(entries + expected.uncertain_entries, expected.tile_entries);
  EXPECT_TRUE(are_few(expected.uncertain_entries, expected.tile_entries, 0.02));
}

TEST_P(RasterizerReference, GradientsAgree) {
  const Case& c = GetParam();
  const Camera camera = camera_of(c);
  SceneData scene = scene_of(c);
  const reference::Camera exact_camera = reference_camera(camera);
  const reference::Options exact_options = reference_options(c.options);
  const reference::Scene<double> exact_scene = scene.reference();
  const auto exact_images = reference::render(exact_scene, exact_camera, exact_options);
  const ImageGradientData weights(camera, scene.features_per_gaussian, c.seed + 100, exact_images.uncertain);

  Threads threads(2);
  Rasterizer rasterizer(threads);
  ImageData images(camera, scene.features_per_gaussian);
  rasterizer.forward(camera, scene.view(), c.options, images.view());
  GradientData gradients(scene);
  rasterizer.backward(scene.view(), weights.view(), gradients.view());

  const Tolerance tolerance{.relative = c.rounding * kGradientTolerance.relative,
                            .scale = c.rounding * kGradientTolerance.scale,
                            .absolute = 0,
                            .l2 = c.rounding * kGradientTolerance.l2};
  const auto check = [&](const char* name, const std::vector<float>& actual, Input input) {
    if (actual.empty()) return;
    // Every element of small scenes; otherwise every few, with a stride coprime to the row widths.
    const std::size_t stride = scene.count <= 24 ? 1 : scene.count <= 100 ? 7 : 23;
    std::vector<std::size_t> elements;
    std::vector<float> picked;
    for (std::size_t k = 0; k < actual.size(); ++k) {
      if (k % stride == 0) {
        elements.push_back(k);
        picked.push_back(actual[k]);
      }
      EXPECT_TRUE(std::isfinite(actual[k])) << name << " " << k;
    }
    const auto exact =
        reference::gradient(exact_scene, exact_camera, exact_options, weights.reference(), input, elements);
    EXPECT_TRUE(is_close(picked, exact.sum, tolerance)) << name;
  };
  check("means", gradients.means, Input::means);
  check("scales", gradients.scales, Input::scales);
  check("rotations", gradients.rotations, Input::rotations);
  check("opacities", gradients.opacities, Input::opacities);
  check("sh_dc", gradients.sh_dc, Input::sh_dc);
  check("colors", gradients.colors, Input::colors);
  check("features", gradients.features, Input::features);
  // The many coefficients are checked in a few cases only; those of the named degree are the last of a Gaussian.
  if (c.name.find("_sh") != std::string::npos || c.name == "inactive_degrees") {
    check("sh_rest", gradients.sh_rest, Input::sh_rest);
  }
  if (scene.covariances.size() > 0) {
    // The six numbers are the independent entries of a symmetric matrix: an off-diagonal one changes two entries.
    check("covariances", gradients.covariances, Input::covariances);
  }
  const auto screen =
      reference::gradient(exact_scene, exact_camera, exact_options, weights.reference(), Input::screen_means);
  EXPECT_TRUE(is_close(gradients.screen_means, screen.sum, tolerance)) << "screen_means";
  EXPECT_TRUE(is_close(gradients.screen_means_abs, screen.absolute_sum, tolerance)) << "screen_means_abs";
}

TEST_P(RasterizerReference, CountsAgreeAwayFromThresholds) {
  const Case& c = GetParam();
  const Camera camera = camera_of(c);
  const SceneData scene = scene_of(c);
  Threads threads(2);
  Rasterizer rasterizer(threads);
  ImageData images(camera, scene.features_per_gaussian);
  rasterizer.forward(camera, scene.view(), c.options, images.view());
  const reference::Camera exact_camera = reference_camera(camera);
  const reference::Options exact_options = reference_options(c.options);
  const auto expected = reference::render(scene.reference(), exact_camera, exact_options);
  std::vector<std::uint8_t> flagged(expected.uncertain.size());
  Numbers random(c.seed + 200);
  for (std::size_t pixel = 0; pixel < flagged.size(); ++pixel) {
    // Any non-zero byte is a flag.
    flagged[pixel] = expected.uncertain[pixel] != 0 || random.uniform(0, 1) < 0.4
                         ? 0
                         : static_cast<std::uint8_t>(1 + random.bits() % 255);
  }
  const auto exact = reference::count_flagged(scene.reference(), exact_camera, exact_options, flagged);
  std::vector<std::int32_t> counts(scene.count, 0);
  rasterizer.count_flagged(flagged, counts);
  for (std::size_t i = 0; i < scene.count; ++i) EXPECT_EQ(counts[i], exact[i]) << i;
}

INSTANTIATE_TEST_SUITE_P(Scenes, RasterizerReference, ::testing::ValuesIn(cases()),
                         [](const auto& given) { return given.param.name; });

// Thousands of faint splats per pixel: long sums, long products.
TEST(RasterizerReferenceDeep, ValuesAndGradientsAgree) {
  Camera camera = oblique_camera(19, 18);
  SceneSpec spec;
  spec.count = 4000;
  spec.colors = true;
  spec.smallest = 2;
  spec.largest = 12;
  spec.opacity_low = 0.001;
  spec.opacity_high = 0.012;
  spec.behind = 0;
  SceneData scene = random_scene(camera, spec, 5);
  for (const BoxPolicy box : {BoxPolicy::square, BoxPolicy::ellipse}) {
    RasterOptions options = square();
    options.box = box;
    Threads threads(2);
    Rasterizer rasterizer(threads);
    ImageData images(camera, 0);
    rasterizer.forward(camera, scene.view(), options, images.view());
    const reference::Camera exact_camera = reference_camera(camera);
    const reference::Options exact_options = reference_options(options);
    const auto exact_scene = scene.reference();
    const auto expected = reference::render(exact_scene, exact_camera, exact_options);
    // Most pixels have some splat near the threshold of 1/255 or of equal depth, so they cannot be excluded. Each
    // decision changes a value by at most 1/255 of the remaining transmittance, and a few of a thousand are uncertain.
    const Tolerance deep{.relative = 1e-4, .scale = 0, .absolute = 1e-4 + 1.0 / 255, .l2 = 1e-3};
    EXPECT_TRUE(is_close(images.color, expected.color, deep));
    EXPECT_TRUE(is_close(images.alpha, expected.alpha, deep));
    EXPECT_TRUE(is_close(images.color, expected.color, {.relative = 2e-4, .scale = 2e-5, .absolute = 2e-5, .l2 = 1e-4},
                         expected.uncertain));
    // ... yet there are enough certain pixels for a test.
    EXPECT_GT(expected.uncertain.size() - count_nonzero(expected.uncertain), expected.uncertain.size() / 4);

    const ImageGradientData weights(camera, 0, 77, expected.uncertain);
    GradientData gradients(scene);
    rasterizer.backward(scene.view(), weights.view(), gradients.view());
    std::vector<std::size_t> elements;  // of [N,3]
    for (std::size_t k = 0; k < 3 * scene.count; k += 379) elements.push_back(k);
    const auto pick = [&](const std::vector<float>& values, const std::vector<std::size_t>& which) {
      std::vector<float> picked;
      for (const std::size_t k : which) picked.push_back(values[k]);
      return picked;
    };
    const Tolerance tolerance{.relative = 1e-3, .scale = 1e-4, .absolute = 0, .l2 = 2e-4};
    const auto means =
        reference::gradient(exact_scene, exact_camera, exact_options, weights.reference(), Input::means, elements);
    EXPECT_TRUE(is_close(pick(gradients.means, elements), means.sum, tolerance)) << "means";
    const auto colors =
        reference::gradient(exact_scene, exact_camera, exact_options, weights.reference(), Input::colors, elements);
    EXPECT_TRUE(is_close(pick(gradients.colors, elements), colors.sum, tolerance)) << "colors";

    // All inputs at once, along random directions.
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      Numbers random(seed);
      reference::Scene<double> direction;
      double along = 0;
      double size = 0;
      const auto move = [&](std::vector<double>& speeds, const std::vector<float>& slopes) {
        for (const float slope : slopes) {
          speeds.push_back(random.uniform(-1, 1));
          along += speeds.back() * static_cast<double>(slope);
          size += std::abs(speeds.back() * static_cast<double>(slope));
        }
      };
      move(direction.means, gradients.means);
      move(direction.scales, gradients.scales);
      move(direction.rotations, gradients.rotations);
      move(direction.opacities, gradients.opacities);
      move(direction.colors, gradients.colors);
      const double exact =
          reference::directional_derivative(exact_scene, direction, exact_camera, exact_options, weights.reference());
      EXPECT_NEAR(along, exact, 1e-5 * size);
    }
  }
}

TEST(RasterizerReferenceTies, EqualDepthsAreBlendedByIndex) {
  Camera camera = oblique_camera(16, 16);
  camera.camera_from_world = glm::mat4(1);
  SceneData scene;
  scene.count = 40;
  for (std::size_t i = 0; i < scene.count; ++i) {
    for (const float v : {0.f, 0.f, 2.f}) scene.means.push_back(v);
    for (const float v : {1.f, 0.f, 0.f, 1.f, 0.f, 1.f}) scene.covariances.push_back(v);
    scene.opacities.push_back(0.1f);
    for (int c = 0; c < 3; ++c) scene.colors.push_back(static_cast<float>(i));
  }
  Threads threads(2);
  Rasterizer rasterizer(threads);
  ImageData images(camera, 0);
  rasterizer.forward(camera, scene.view(), RasterOptions{}, images.view());
  const auto expected = reference::render(scene.reference(), reference_camera(camera), {});
  ASSERT_EQ(count_nonzero(expected.uncertain), 0u);
  EXPECT_TRUE(is_close(images.color, expected.color, kImageTolerance));
}

TEST(RasterizerGradientMode, AccumulateAddsAndLeavesUndrawnRowsAlone) {
  const Camera camera = oblique_camera(40, 30);
  SceneSpec spec;
  spec.features = 2;
  spec.behind = 0.4;
  for (const bool covariances : {false, true}) {
    spec.covariances = covariances;
    spec.colors = covariances;
    const SceneData scene = random_scene(camera, spec, 91);
    Threads threads(2);
    Rasterizer rasterizer(threads);
    ImageData images(camera, 2);
    rasterizer.forward(camera, scene.view(), square(), images.view());
    const ImageGradientData weights(camera, 2, 92, {});
    GradientData once(scene);
    rasterizer.backward(scene.view(), weights.view(), once.view());
    GradientData added(scene, 3.25f);
    rasterizer.backward(scene.view(), weights.view(), added.view(GradientMode::accumulate));

    std::size_t undrawn = 0;
    for (std::size_t i = 0; i < scene.count; ++i) undrawn += rasterizer.visible()[i] == 0 ? 1 : 0;
    ASSERT_GT(undrawn, 3u);
    ASSERT_LT(undrawn, scene.count - 3);
    const auto check = [&](const char* name, const std::vector<float>& alone, const std::vector<float>& sum) {
      const std::size_t width = alone.size() / scene.count;
      std::vector<float> expected(alone);
      for (std::size_t k = 0; k < alone.size(); ++k) {
        expected[k] += 3.25f;
        if (rasterizer.visible()[k / width] != 0) continue;
        EXPECT_EQ(alone[k], 0) << name << " " << k;
        EXPECT_EQ(sum[k], 3.25f) << name << " " << k;
      }
      SCOPED_TRACE(name);
      expect_same_gradients(sum, expected);
    };
    check("means", once.means, added.means);
    check("scales", once.scales, added.scales);
    check("rotations", once.rotations, added.rotations);
    check("covariances", once.covariances, added.covariances);
    check("opacities", once.opacities, added.opacities);
    check("sh_dc", once.sh_dc, added.sh_dc);
    check("sh_rest", once.sh_rest, added.sh_rest);
    check("colors", once.colors, added.colors);
    check("features", once.features, added.features);
    // Statistics of one view are overwritten in both modes.
    expect_same_gradients(added.screen_means, once.screen_means);
    expect_same_gradients(added.screen_means_abs, once.screen_means_abs);
  }
}

TEST(RasterizerGradientMode, SpansThatAreEmptyChangeNothingElse) {
  const Camera camera = oblique_camera(40, 30);
  const SceneData scene = random_scene(camera, {.features = 1}, 93);
  Threads threads(2);
  Rasterizer rasterizer(threads);
  ImageData images(camera, 1);
  rasterizer.forward(camera, scene.view(), square(), images.view());
  const ImageGradientData weights(camera, 1, 94, {});
  GradientData all(scene);
  rasterizer.backward(scene.view(), weights.view(), all.view());
  const auto alone = [&](std::span<float> GaussianGradients::*span, const std::vector<float>& expected) {
    std::vector<float> values(expected.size(), std::nanf(""));
    GaussianGradients gradients;
    gradients.*span = values;
    rasterizer.backward(scene.view(), weights.view(), gradients);
    expect_same_gradients(values, expected);
  };
  alone(&GaussianGradients::means, all.means);
  alone(&GaussianGradients::scales, all.scales);
  alone(&GaussianGradients::rotations, all.rotations);
  alone(&GaussianGradients::opacities, all.opacities);
  alone(&GaussianGradients::sh_dc, all.sh_dc);
  alone(&GaussianGradients::sh_rest, all.sh_rest);
  alone(&GaussianGradients::features, all.features);
  alone(&GaussianGradients::screen_means, all.screen_means);
  alone(&GaussianGradients::screen_means_abs, all.screen_means_abs);
}

TEST(RasterizerGradientMode, AnEmptyImageGradientIsZero) {
  const Camera camera = oblique_camera(40, 30);
  const SceneData scene = random_scene(camera, {.features = 2}, 95);
  const auto exact_scene = scene.reference();
  const auto exact_camera = reference_camera(camera);
  const auto exact_options = reference_options(square());
  const auto exact_images = reference::render(exact_scene, exact_camera, exact_options);
  const ImageGradientData weights(camera, 2, 96, exact_images.uncertain);
  Threads threads(2);
  Rasterizer rasterizer(threads);
  // The backward pass with the gradient of one image alone, whether or not the forward pass wrote the others.
  for (int which = 0; which < 4; ++which) {
    ImageData images(camera, 2);
    RasterImages only{images.color, {}, {}, {}};
    RasterImageGradients driving;
    reference::ImageGradients exact_driving;
    const auto all = weights.reference();
    if (which == 0) driving.color = weights.color, exact_driving.color = all.color;
    if (which == 1) driving.features = weights.features, exact_driving.features = all.features;
    if (which == 2) driving.inverse_depth = weights.inverse_depth, exact_driving.inverse_depth = all.inverse_depth;
    if (which == 3) driving.alpha = weights.alpha, exact_driving.alpha = all.alpha;
    if (which == 1) only.features = images.features;
    if (which == 2) only.inverse_depth = images.inverse_depth;
    if (which == 3) only.alpha = images.alpha;
    rasterizer.forward(camera, scene.view(), square(), only);
    GradientData gradients(scene);
    rasterizer.backward(scene.view(), driving, gradients.view());
    const auto check = [&](const char* name, const std::vector<float>& actual, Input input) {
      const auto exact = reference::gradient(exact_scene, exact_camera, exact_options, exact_driving, input);
      EXPECT_TRUE(is_close(actual, exact.sum, kGradientTolerance)) << name << " from image " << which;
    };
    check("means", gradients.means, Input::means);
    check("scales", gradients.scales, Input::scales);
    check("opacities", gradients.opacities, Input::opacities);
    check("sh_dc", gradients.sh_dc, Input::sh_dc);
    check("features", gradients.features, Input::features);
  }
}

TEST(RasterizerGradientMode, GradientsWhereNothingIsDrawnMayBeAnything) {
  const Camera camera = oblique_camera(60, 45);
  Threads threads(2);
  Rasterizer rasterizer(threads);
  for (const int features : {0, 3}) {  // 3 and the inverse depth are the number of channels that loops are unrolled for
    const SceneData scene = random_scene(camera, {.features = features, .smallest = 0.5, .largest = 2}, 97);
    ImageData images(camera, features);
    rasterizer.forward(camera, scene.view(), square(), images.view());
    const ImageGradientData weights(camera, features, 98, {});
    ImageGradientData anything = weights;
    std::size_t empty = 0;
    const std::size_t pixels = images.alpha.size();
    for (std::size_t p = 0; p < pixels; ++p) {
      if (images.alpha[p] != 0) continue;
      const float value = ++empty % 2 == 0 ? INFINITY : NAN;
      for (auto* plane : {&anything.color, &anything.features, &anything.inverse_depth, &anything.alpha}) {
        for (std::size_t k = p; k < plane->size(); k += pixels) (*plane)[k] = value;
      }
    }
    ASSERT_GT(empty, pixels / 4);
    ASSERT_LT(empty, pixels - pixels / 8);
    for (const bool color_alone : {false, true}) {
      GradientData expected(scene), found(scene);
      const auto driving = [&](const ImageGradientData& of) {
        return color_alone ? RasterImageGradients{of.color, {}, {}, {}} : of.view();
      };
      rasterizer.backward(scene.view(), driving(weights), expected.view());
      rasterizer.backward(scene.view(), driving(anything), found.view());
      for (std::size_t k = 0; k < found.all().size(); ++k) expect_same_gradients(*found.all()[k], *expected.all()[k]);
    }
  }
}

// One object draws views of many sizes and kinds; earlier views must not affect later ones.
TEST(RasterizerWorkspace, ReuseGivesTheBytesOfAFreshObject) {
  Threads threads(2);
  Rasterizer reused(threads);
  const auto all = cases();
  for (const std::size_t k : {3u, 0u, 16u, 26u, 12u, 5u, 34u, 1u}) {
    const Case& c = all.at(k);
    const Camera camera = camera_of(c);
    const SceneData scene = scene_of(c);
    Rasterizer fresh(threads);
    ImageData a(camera, scene.features_per_gaussian);
    ImageData b(camera, scene.features_per_gaussian);
    reused.forward(camera, scene.view(), c.options, a.view());
    fresh.forward(camera, scene.view(), c.options, b.view());
    EXPECT_EQ(a.color, b.color);
    EXPECT_EQ(a.features, b.features);
    EXPECT_EQ(a.inverse_depth, b.inverse_depth);
    EXPECT_EQ(a.alpha, b.alpha);
    const ImageGradientData weights(camera, scene.features_per_gaussian, 7, {});
    GradientData ga(scene);
    GradientData gb(scene);
    reused.backward(scene.view(), weights.view(), ga.view());
    fresh.backward(scene.view(), weights.view(), gb.view());
    expect_same_gradients(ga.means, gb.means);
    expect_same_gradients(ga.opacities, gb.opacities);
    expect_same_gradients(ga.screen_means_abs, gb.screen_means_abs);
    Rasterizer moved(std::move(fresh));
    GradientData gc(scene);
    moved.backward(scene.view(), weights.view(), gc.view());
    expect_same_gradients(gc.means, gb.means);
  }
}

}  // namespace
}  // namespace splatboost::test

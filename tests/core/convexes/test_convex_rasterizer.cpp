// SPDX-License-Identifier: Apache-2.0
// The convex rasterizer against the double-precision reference: images, gradients, counts, listings.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <ostream>
#include <string>
#include <vector>

#include "support/compare.h"
#include "support/convex_scenes.h"
#include "support/tested_convex_rasterizer.h"

namespace splatboost::test {
namespace {

struct Case {
  std::string name;
  ConvexSceneSpec spec;
  ConvexOptions options;
};

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

std::vector<Case> cases() {
  std::vector<Case> all;
  const auto add = [&](const char* name, const auto& change) {
    Case one;
    one.name = name;
    change(one);
    all.push_back(one);
  };
  add("Square", [](Case&) {});
  add("Compact", [](Case& c) { c.options.box = ConvexBox::compact; });
  add("HalfBeta", [](Case& c) {
    c.options.box = ConvexBox::compact;
    c.options.beta = 0.5f;
    c.options.background = glm::vec3(0.2f, 0.5f, 1.0f);
  });
  add("Triangles", [](Case& c) {
    c.spec.points_per_convex = 3;
    c.options.box = ConvexBox::compact;
    c.spec.colors = true;
  });
  add("EightPoints", [](Case& c) {
    c.spec.points_per_convex = 8;
    c.options.box = ConvexBox::compact;
    c.spec.sh_degree = 1;
  });
  add("LargePixels", [](Case& c) {
    c.options.pixel_size = 1.7f;
    c.spec.sh_degree = 0;
  });
  add("Opaque", [](Case& c) {
    c.options.box = ConvexBox::compact;
    c.spec.count = 40;
    c.spec.opacity_low = 0.9;
    c.spec.opacity_high = 1.0;
    c.spec.steep = 60;
    c.spec.colors = true;
  });
  return all;
}

/// ConvexGradients::screen_points [N,3] from the gradients of the points, if colours do not depend on these: moving a
/// point in a plane of constant depth changes only its position on screen.
std::vector<double> screen_sums(const ConvexSceneData& scene, const Camera& camera, const std::vector<double>& points) {
  const glm::mat3 rotation = camera.rotation();
  const glm::vec3 eye = camera.centre();
  const auto per_convex = static_cast<std::size_t>(scene.points_per_convex);
  std::vector<double> sums(3 * scene.count, 0.0);
  for (std::size_t p = 0; p < scene.count * per_convex; ++p) {
    double view[3] = {};
    double along[2] = {};
    for (int axis = 0; axis < 3; ++axis) {
      for (int c = 0; c < 3; ++c) {
        const std::size_t at = 3 * p + static_cast<std::size_t>(c);
        const auto component = static_cast<double>(rotation[c][axis]);
        view[axis] += component * (static_cast<double>(scene.points[at]) - static_cast<double>(eye[c]));
        if (axis < 2) along[axis] += component * points[at];
      }
    }
    const double focal[2] = {static_cast<double>(camera.fx), static_cast<double>(camera.fy)};
    double* const sum = &sums[3 * (p / per_convex)];
    for (int axis = 0; axis < 2; ++axis) {
      const double on_screen = along[axis] * view[2] / focal[axis];
      sum[axis] += on_screen;
      sum[2] += std::abs(on_screen);
    }
  }
  return sums;
}

class ConvexReference : public ::testing::TestWithParam<Case> {
 protected:
  ConvexReference() : scene(random_convexes(camera, GetParam().spec, 11)), options(GetParam().options) {
    color.assign(3 * pixels, std::nanf(""));
    alpha.assign(pixels, std::nanf(""));
    rasterizer.forward(camera, scene.view(), options, color, alpha);
    expected = reference::render(scene.reference(), reference_camera(camera), reference_options(options));
  }

  Camera camera = oblique_camera(67, 50);
  std::size_t pixels = 67 * 50;
  ConvexSceneData scene;
  ConvexOptions options;
  Threads threads{2};
  ConvexRasterizer rasterizer{threads};
  std::vector<float> color, alpha;
  reference::ConvexRendering<double> expected;
};

TEST_P(ConvexReference, Images) {
  EXPECT_TRUE(are_few(count_nonzero(expected.uncertain), pixels, 0.05));
  const Tolerance tolerance{.relative = 2e-5, .scale = 2e-6, .absolute = 3e-6, .l2 = 3e-6};
  EXPECT_TRUE(is_close(color, expected.color, tolerance, expected.uncertain));
  EXPECT_TRUE(is_close(alpha, expected.alpha, tolerance, expected.uncertain));
  EXPECT_GT(*std::max_element(alpha.begin(), alpha.end()), 0.3f) << "an empty image tests nothing";
}

TEST_P(ConvexReference, Listings) {
  EXPECT_NEAR(static_cast<double>(rasterizer.counts().tile_entries), static_cast<double>(expected.tile_entries),
              static_cast<double>(expected.uncertain_entries));
  EXPECT_LE(expected.uncertain_entries, 1 + expected.tile_entries / 20);
  for (std::size_t i = 0; i < scene.count; ++i) {
    if (expected.listing_uncertain[i] == 0) {
      EXPECT_EQ(rasterizer.visible()[i], expected.visible[i]) << i;
    }
  }
}

TEST_P(ConvexReference, Gradients) {
  const ImageGradientData up(camera, 0, 3, expected.uncertain);
  ConvexGradientData gradients(scene);
  rasterizer.backward(scene.view(), up.color, up.alpha, gradients.view());
  const reference::ConvexImageGradients exact_up{up.reference().color, up.reference().alpha};
  const auto exact = [&](reference::ConvexInput input) {
    return reference::gradient(scene.reference(), reference_camera(camera), reference_options(options), exact_up,
                               input);
  };
  // About three times the error of single precision.
  const Tolerance tolerance{.relative = 5e-4, .scale = 5e-5, .absolute = 0, .l2 = 5e-5};
  const auto expect = [&](const char* name, const std::vector<float>& actual, reference::ConvexInput input) {
    SCOPED_TRACE(name);
    EXPECT_TRUE(is_close(actual, exact(input).sum, tolerance));
  };
  expect("points", gradients.points, reference::ConvexInput::points);
  expect("smoothness", gradients.smoothness, reference::ConvexInput::smoothness);
  expect("opacities", gradients.opacities, reference::ConvexInput::opacities);
  if (GetParam().spec.colors) {
    expect("colors", gradients.colors, reference::ConvexInput::colors);
  } else {
    expect("sh_dc", gradients.sh_dc, reference::ConvexInput::sh_dc);
    expect("sh_rest", gradients.sh_rest, reference::ConvexInput::sh_rest);
  }
  const reference::Gradient sharpness = exact(reference::ConvexInput::sharpness);
  EXPECT_TRUE(is_close(gradients.sharpness, sharpness.sum, tolerance));
  EXPECT_EQ(gradients.view_sharpness, gradients.sharpness);
  EXPECT_TRUE(is_close(gradients.view_sharpness_abs, sharpness.absolute_sum, tolerance));
  if (GetParam().spec.colors) {
    const std::vector<double> of_points = exact(reference::ConvexInput::points).sum;
    EXPECT_TRUE(is_close(gradients.screen_points, screen_sums(scene, camera, of_points), tolerance));
  }

  // Gradients accumulate; statistics of one view are overwritten.
  ConvexGradientData twice = gradients;
  rasterizer.backward(scene.view(), up.color, up.alpha, twice.view(GradientMode::accumulate));
  for (std::size_t k = 0; k < twice.points.size(); ++k) {
    EXPECT_NEAR(twice.points[k], 2 * gradients.points[k], 1e-4f * std::abs(gradients.points[k]) + 1e-6f);
  }
  expect_same_gradients(twice.view_sharpness, gradients.view_sharpness);
  expect_same_gradients(twice.screen_points, gradients.screen_points);
}

TEST_P(ConvexReference, Counts) {
  Numbers random(5);
  for (const double share : {0.03, 1.0}) {
    std::vector<std::uint8_t> flagged(pixels);
    for (std::size_t p = 0; p < pixels; ++p) {
      flagged[p] = expected.uncertain[p] == 0 && random.uniform(0, 1) < share ? 1 : 0;
    }
    std::vector<std::int32_t> counts(scene.count, 7);
    rasterizer.count_flagged(flagged, counts);
    const std::vector<std::int64_t> exact =
        reference::count_flagged(scene.reference(), reference_camera(camera), reference_options(options), flagged);
    for (std::size_t i = 0; i < scene.count; ++i) EXPECT_EQ(counts[i], 7 + exact[i]) << i;
  }
}

TEST_P(ConvexReference, Weights) {
  std::vector<std::int32_t> weights(scene.count, 7), blended(scene.count, 0);
  rasterizer.add_weights(weights);
  rasterizer.count_flagged(std::vector<std::uint8_t>(pixels, 1), blended);
  std::vector<std::uint8_t> certain;
  const std::vector<std::int64_t> truth =
      reference::blending_weights(scene.reference(), reference_camera(camera), reference_options(options), certain);
  const std::vector<std::int64_t> exact = reference::count_flagged(
      scene.reference(), reference_camera(camera), reference_options(options), std::vector<std::uint8_t>(pixels, 1));
  std::size_t compared = 0;
  for (std::size_t i = 0; i < scene.count; ++i) {
    // Tolerates pixels at a threshold and weights that round differently, which affect later weights slightly.
    EXPECT_NEAR(weights[i], 7 + static_cast<double>(truth[i]), 2 + 0.002 * blended[i]) << i;
    compared += certain[i] != 0 && blended[i] == exact[i] && weights[i] == 7 + truth[i] ? 1 : 0;
  }
  EXPECT_GT(compared, scene.count / 4) << "equal to the last unit where no rounding is doubtful";
  // Sums stop at the largest number.
  constexpr std::int32_t most = std::numeric_limits<std::int32_t>::max();
  std::vector<std::int32_t> full(scene.count, most - 10);
  rasterizer.add_weights(full);
  for (std::size_t i = 0; i < scene.count; ++i) EXPECT_EQ(full[i], most - 10 + std::min(weights[i] - 7, 10)) << i;
}

INSTANTIATE_TEST_SUITE_P(All, ConvexReference, ::testing::ValuesIn(cases()),
                         [](const auto& one) { return one.param.name; });

/// The reference's own derivatives against finite differences.
TEST(ConvexWitness, DerivativesAreDifferences) {
  const Camera camera = oblique_camera(33, 30);
  ConvexSceneSpec spec;
  spec.count = 4;
  spec.sh_degree = 1;
  spec.behind = 0;
  const ConvexSceneData data = random_convexes(camera, spec, 4);
  const reference::ConvexScene<double> scene = data.reference();
  reference::ConvexOptions options;
  options.compact = true;
  const reference::Camera exact_camera = reference_camera(camera);
  const auto rendered = reference::render(scene, exact_camera, options);
  const ImageGradientData up(camera, 0, 8, rendered.uncertain);
  const reference::ConvexImageGradients exact_up{up.reference().color, up.reference().alpha};
  for (const auto input :
       {reference::ConvexInput::points, reference::ConvexInput::smoothness, reference::ConvexInput::sharpness,
        reference::ConvexInput::opacities, reference::ConvexInput::sh_rest}) {
    const std::vector<double> exact = reference::gradient(scene, exact_camera, options, exact_up, input).sum;
    double largest = 0;
    for (const double g : exact) largest = std::max(largest, std::abs(g));
    for (std::size_t k = 0; k < exact.size(); k += 5) {
      reference::ConvexScene<double> moved = scene;
      double& value = reference::field(moved, input)[k];
      const double at = value, step = 1e-6 * std::max(1e-2, std::abs(at));
      value = at + step;
      const double above = reference::objective(moved, exact_camera, options, exact_up);
      value = at - step;
      const double below = reference::objective(moved, exact_camera, options, exact_up);
      EXPECT_NEAR((above - below) / (2 * step), exact[k], 1e-5 * (largest + std::abs(exact[k]))) << k;
    }
  }
}

TEST(ConvexRasterizer, ReleasedViewDirectionIsOfTheCentresDepthAlone) {
  const Camera camera = oblique_camera(48, 40);
  ConvexSceneSpec spec;
  spec.behind = 0;
  const ConvexSceneData scene = random_convexes(camera, spec, 23);
  ConvexOptions options;
  options.released_view_direction = true;
  Threads threads(1);
  ConvexRasterizer rasterizer(threads);
  std::vector<float> color(3 * 48 * 40), usual(color.size());
  rasterizer.forward(camera, scene.view(), options, color);
  const auto expected = reference::render(scene.reference(), reference_camera(camera), reference_options(options));
  EXPECT_TRUE(is_close(color, expected.color, {.relative = 2e-5, .scale = 2e-6, .absolute = 3e-6, .l2 = 3e-6},
                       expected.uncertain));
  rasterizer.forward(camera, scene.view(), {}, usual);
  EXPECT_NE(color, usual);
}

TEST(ConvexRasterizer, AViewOfHalfTheSizeLooksTheSame) {
  Camera camera = oblique_camera(64, 48);
  ConvexSceneSpec spec;
  spec.count = 5;
  spec.behind = 0;
  spec.smallest = 12;
  spec.steep = 0.8;  // softer than one pixel
  spec.colors = true;
  const ConvexSceneData scene = random_convexes(camera, spec, 2);
  Threads threads(1);
  ConvexRasterizer rasterizer(threads);
  ConvexOptions options;
  options.box = ConvexBox::compact;
  std::vector<float> full(3 * 64 * 48), half(3 * 32 * 24);
  rasterizer.forward(camera, scene.view(), options, full);
  for (float* value : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *value /= 2;
  camera.width /= 2;
  camera.height /= 2;
  options.pixel_size = 2;
  rasterizer.forward(camera, scene.view(), options, half);
  double difference = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t y = 0; y < 24; ++y) {
      for (std::size_t x = 0; x < 32; ++x) {
        const float* const from = &full[(c * 48 + 2 * y) * 64 + 2 * x];
        const float mean = (from[0] + from[1] + from[64] + from[65]) / 4;
        difference += std::abs(mean - half[(c * 24 + y) * 32 + x]);
      }
    }
  }
  EXPECT_LT(difference / static_cast<double>(half.size()), 0.01);
}

/// A visible convex of six points: a square plate of size 0.4 in front of the camera.
ConvexSceneData plate() {
  ConvexSceneData scene;
  scene.count = 1;
  scene.points = {-0.2f, -0.2f, 2, 0.2f, -0.2f, 2, 0.2f, 0.2f, 2, -0.2f, 0.2f, 2, 0, 0, 2, 0.05f, 0, 2};
  scene.smoothness = {0.1f};
  scene.sharpness = {0.05f};
  scene.opacities = {0.8f};
  scene.colors = {1, 0.5f, 0.25f};
  return scene;
}

Camera plain_camera() {
  Camera camera;
  camera.width = 40;
  camera.height = 36;
  camera.fx = camera.fy = 60;
  camera.cx = 20;
  camera.cy = 18;
  return camera;
}

TEST(ConvexRasterizer, GradientsWhereNothingIsDrawnMayBeAnything) {
  const Camera camera = plain_camera();
  ConvexSceneData scene = plate();
  scene.sharpness = {1};  // so that it does not cover the image
  Threads threads(1);
  ConvexRasterizer rasterizer(threads);
  ConvexOptions options;
  options.background = glm::vec3(0.25f);
  const std::size_t pixels = 40 * 36;
  std::vector<float> color(3 * pixels), alpha(pixels);
  rasterizer.forward(camera, scene.view(), options, color, alpha);
  const ImageGradientData up(camera, 0, 3, {});
  ImageGradientData anything = up;
  std::size_t empty = 0;
  for (std::size_t p = 0; p < pixels; ++p) {
    if (alpha[p] != 0) continue;
    ++empty;
    for (std::size_t c = 0; c < 3; ++c) anything.color[c * pixels + p] = std::nanf("");
    anything.alpha[p] = std::numeric_limits<float>::infinity();
  }
  ASSERT_GT(empty, pixels / 4);
  ASSERT_LT(empty, pixels - 100);
  ConvexGradientData expected(scene), found(scene);
  rasterizer.backward(scene.view(), up.color, up.alpha, expected.view());
  rasterizer.backward(scene.view(), anything.color, anything.alpha, found.view());
  for (std::size_t k = 0; k < found.all().size(); ++k) expect_same_gradients(*found.all()[k], *expected.all()[k]);
}

TEST(ConvexRasterizer, DrawsNothingOfWhatIsNotAConvexOnTheScreen) {
  const Camera camera = plain_camera();
  Threads threads(1);
  ConvexRasterizer rasterizer(threads);
  const float nan = std::nanf(""), infinite = std::numeric_limits<float>::infinity();
  const auto with = [&](const auto& change) {
    ConvexSceneData scene = plate();
    change(scene);
    return scene;
  };
  const auto set_all = [&](std::size_t axis, float value) {
    return with([=](ConvexSceneData& scene) {
      for (std::size_t k = axis; k < scene.points.size(); k += 3) scene.points[k] = value;
    });
  };
  std::vector<std::pair<std::string, ConvexSceneData>> scenes;
  scenes.emplace_back("collinear", set_all(1, 0.1f));
  scenes.emplace_back("one point", with([](ConvexSceneData& s) {
                        for (std::size_t k = 0; k < s.points.size(); ++k) s.points[k] = k % 3 == 2 ? 2.0f : 0.1f;
                      }));
  scenes.emplace_back("behind", set_all(2, -2));
  scenes.emplace_back("at the camera", set_all(2, 0));
  scenes.emplace_back("too near", set_all(2, 0.1f));
  scenes.emplace_back("a point behind", with([](ConvexSceneData& s) { s.points[2] = -0.5f; }));
  scenes.emplace_back("a point at the camera's plane", with([](ConvexSceneData& s) { s.points[2] = 1e-30f; }));
  scenes.emplace_back("huge", with([](ConvexSceneData& s) {
                        for (std::size_t k = 0; k < s.points.size(); ++k) s.points[k] *= k % 3 == 2 ? 1.0f : 1e6f;
                      }));
  scenes.emplace_back("far beyond numbers", set_all(0, 3e38f));
  for (const float bad : {nan, infinite, -infinite}) {
    for (std::size_t k = 0; k < 3; ++k)
      scenes.emplace_back("a point not finite", with([=](ConvexSceneData& s) { s.points[3 + k] = bad; }));
    scenes.emplace_back("smoothness", with([=](ConvexSceneData& s) { s.smoothness[0] = bad; }));
    scenes.emplace_back("sharpness", with([=](ConvexSceneData& s) { s.sharpness[0] = bad; }));
  }
  scenes.emplace_back("no smoothness", with([](ConvexSceneData& s) { s.smoothness[0] = 0; }));
  scenes.emplace_back("no sharpness", with([](ConvexSceneData& s) { s.sharpness[0] = 0; }));
  scenes.emplace_back("opacity not a number", with([=](ConvexSceneData& s) { s.opacities[0] = nan; }));
  scenes.emplace_back("faint", with([](ConvexSceneData& s) { s.opacities[0] = 1.0f / 255.0f; }));

  for (const ConvexBox box : {ConvexBox::square, ConvexBox::compact}) {
    ConvexOptions options;
    options.box = box;
    options.background = glm::vec3(0.25f);
    std::vector<float> color(3 * 40 * 36);
    const ConvexSceneData seen = plate();
    rasterizer.forward(camera, seen.view(), options, color);
    EXPECT_NEAR(color[18 * 40 + 20], 0.8f, 0.1f) << "the plate itself is drawn";
    for (const auto& [name, scene] : scenes) {
      SCOPED_TRACE(name);
      rasterizer.forward(camera, scene.view(), options, color);
      EXPECT_EQ(rasterizer.visible()[0], 0);
      for (const float value : color) ASSERT_EQ(value, 0.25f);
      ConvexGradientData gradients(scene);
      const std::vector<float> up(color.size(), 1.0f);
      rasterizer.backward(scene.view(), up, {}, gradients.view());
      for (const std::vector<float>* values : gradients.all()) {
        for (const float value : *values) ASSERT_EQ(value, 0.0f);
      }
    }
  }
}

/// Collinear points in space, in any order: on screen they are off the line only by rounding.
TEST(ConvexRasterizer, DrawsNothingOfPointsOnALine) {
  Numbers random(11);
  ConvexSceneData scene;
  scene.count = 300;
  for (std::size_t i = 0; i < scene.count; ++i) {
    float from[3], along[3];
    for (std::size_t c = 0; c < 3; ++c) {
      from[c] = random.real(-0.3f, 0.3f) + (c == 2 ? 2.0f : 0.0f);
      along[c] = random.real(0.05f, 0.1f) * (random.bits() % 2 == 0 ? 1.0f : -1.0f);
    }
    for (const int k : {3, 0, 5, 1, 4, 2}) {
      for (std::size_t c = 0; c < 3; ++c) scene.points.push_back(from[c] + static_cast<float>(k) * along[c]);
    }
  }
  scene.smoothness.assign(scene.count, 0.1f);
  scene.sharpness.assign(scene.count, 0.05f);
  scene.opacities.assign(scene.count, 0.8f);
  scene.colors.assign(3 * scene.count, 0.5f);
  Threads threads(1);
  ConvexRasterizer rasterizer(threads);
  std::vector<float> color(3 * 40 * 36);
  rasterizer.forward(plain_camera(), scene.view(), {}, color);
  EXPECT_EQ(rasterizer.counts().visible, 0u);
}

TEST(ConvexRasterizer, StaysFiniteWhereNumbersAreExtreme) {
  const Camera camera = plain_camera();
  Threads threads(1);
  ConvexRasterizer rasterizer(threads);
  Numbers random(9);
  for (int round = 0; round < some_of(300); ++round) {
    ConvexSceneSpec spec;
    spec.count = 8;
    spec.sh_degree = 1;
    ConvexSceneData scene = random_convexes(camera, spec, random.bits());
    for (std::size_t i = 0; i < scene.count; ++i) {
      scene.smoothness[i] *= static_cast<float>(random.magnitude(1e-12, 1e12));
      scene.sharpness[i] *= static_cast<float>(random.magnitude(1e-12, 1e12));
      if (random.uniform(0, 1) < 0.3) scene.opacities[i] = random.real(0, 3e-2);
      const auto size = static_cast<float>(random.magnitude(1e-3, 1e3));
      for (std::size_t k = 18 * i + 3; k < 18 * (i + 1); ++k) {
        scene.points[k] = scene.points[18 * i + k % 3] + size * (scene.points[k] - scene.points[18 * i + k % 3]);
      }
    }
    ConvexOptions options;
    options.box = round % 2 == 0 ? ConvexBox::square : ConvexBox::compact;
    std::vector<float> color(3 * 40 * 36), alpha(40 * 36);
    rasterizer.forward(camera, scene.view(), options, color, alpha);
    for (const float value : color) ASSERT_TRUE(std::isfinite(value));
    for (const float value : alpha) ASSERT_TRUE(value >= 0 && value <= 1);
    ConvexGradientData gradients(scene);
    const std::vector<float> up(color.size(), 1.0f);
    rasterizer.backward(scene.view(), up, {}, gradients.view());
    for (const std::vector<float>* values : gradients.all()) {
      for (const float value : *values) ASSERT_TRUE(std::isfinite(value));
    }
  }
}

}  // namespace
}  // namespace splatboost::test

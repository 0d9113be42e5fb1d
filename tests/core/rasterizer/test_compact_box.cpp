// SPDX-License-Identifier: Apache-2.0
// The tiles of a splat: exactly those that the ellipse (or the square) overlaps, and never one too few.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include <glm/geometric.hpp>

#include "reference/rasterizer.h"
#include "splatboost/rasterizer.h"
#include "splatboost/visibility.h"
#include "support/compare.h"
#include "support/scenes.h"
#include "support/tested_rasterizer.h"

namespace splatboost::test {
namespace {

/// Camera at the origin with unit focal lengths: a Gaussian at depth 1 with a flat covariance projects to the same
/// ellipse in pixels. The field of view is so wide that means are never clamped to it.
Camera flat_camera(int width, int height) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = 1;
  return camera;
}

/// An ellipse in pixels: centre, standard deviations of its axes, rotation of the first axis.
SceneData flat_splat(double x, double y, double major, double minor, double turn, double opacity) {
  const double c = std::cos(turn);
  const double s = std::sin(turn);
  const double a = major * major;
  const double b = minor * minor;
  SceneData scene;
  scene.count = 1;
  scene.means = {static_cast<float>(x), static_cast<float>(y), 1};
  scene.covariances = {static_cast<float>(a * c * c + b * s * s),
                       static_cast<float>((a - b) * c * s),
                       0,
                       static_cast<float>(a * s * s + b * c * c),
                       0,
                       0};
  scene.opacities = {static_cast<float>(opacity)};
  scene.colors = {1, 1, 1};
  return scene;
}

SceneData random_splat(Numbers& random, double width, double height) {
  const double major = random.magnitude(0.05, 60);
  const double minor = major * random.magnitude(0.02, 1);
  const double opacity = random.uniform(0, 1) < 0.2 ? random.magnitude(0.002, 0.05) : random.uniform(0.01, 1);
  const double reach = 1 + 3.5 * major;
  return flat_splat(random.uniform(-reach, width + reach), random.uniform(-reach, height + reach), major, minor,
                    random.uniform(0, 3.1416), opacity);
}

struct Tally {
  std::size_t certain_in = 0;
  std::size_t certain_out = 0;
  std::size_t uncertain = 0;
};

RasterOptions ellipse(float beta) {
  RasterOptions options;
  options.box = BoxPolicy::ellipse;
  options.beta = beta;
  return options;
}

// Images of a single tile: is each ellipse listed in it?
void check_single_tile(const RasterOptions& options, std::size_t trials, std::uint64_t seed) {
  Numbers random(seed);
  const Camera camera = flat_camera(16, 16);
  const auto exact_camera = reference_camera(camera);
  const auto exact_options = reference_options(options);
  Threads threads(1);
  Rasterizer rasterizer(threads);
  std::vector<float> color(3 * 256);
  Tally tally;
  for (std::size_t trial = 0; trial < trials; ++trial) {
    const SceneData scene = random_splat(random, 16, 16);
    rasterizer.forward(camera, scene.view(), options, color_only(color));
    const auto splat = reference::project(scene.reference(), 0, exact_camera, exact_options);
    const auto listing =
        splat.drawn ? reference::tile_lists(splat, 0, 0, exact_camera, exact_options) : reference::TileListing{};
    if (listing.uncertain) {
      ++tally.uncertain;
      continue;
    }
    ++(listing.listed ? tally.certain_in : tally.certain_out);
    ASSERT_EQ(rasterizer.counts().tile_entries, listing.listed ? 1u : 0u)
        << "trial " << trial << ": mean " << scene.means[0] << " " << scene.means[1] << ", covariance "
        << scene.covariances[0] << " " << scene.covariances[1] << " " << scene.covariances[3] << ", opacity "
        << scene.opacities[0];
    ASSERT_EQ(rasterizer.visible()[0] != 0, listing.listed);
  }
  EXPECT_TRUE(are_few(tally.uncertain, trials, 0.002));
  EXPECT_GT(tally.certain_in, trials / 8);
  EXPECT_GT(tally.certain_out, trials / 8);
}

TEST(CompactBox, ATileListsExactlyTheEllipsesThatMeetIt) { check_single_tile(ellipse(1), some_of(60000), 1); }
TEST(CompactBox, ATileListsExactlyTheEllipsesThatMeetItAtHalfBeta) {
  check_single_tile(ellipse(0.5f), some_of(40000), 2);
}
TEST(CompactBox, ATileListsExactlyTheSquaresThatMeetIt) { check_single_tile(RasterOptions{}, some_of(20000), 3); }

// Images of many tiles, the last of each row and column cut by the border.
void check_many_tiles(const RasterOptions& options, std::size_t trials, std::uint64_t seed) {
  Numbers random(seed);
  const Camera camera = flat_camera(150, 75);
  const auto exact_camera = reference_camera(camera);
  const auto exact_options = reference_options(options);
  Threads threads(1);
  Rasterizer rasterizer(threads);
  ImageData images(camera, 0);
  std::size_t entries = 0;
  std::size_t uncertain = 0;
  for (std::size_t trial = 0; trial < trials; ++trial) {
    const SceneData scene = random_splat(random, 150, 75);
    rasterizer.forward(camera, scene.view(), options, images.view());
    const auto splat = reference::project(scene.reference(), 0, exact_camera, exact_options);
    ASSERT_TRUE(splat.drawn);
    std::size_t least = 0;
    std::size_t most = 0;
    for (int ty = 0; ty < camera.tiles_y(); ++ty) {
      for (int tx = 0; tx < camera.tiles_x(); ++tx) {
        const auto listing = reference::tile_lists(splat, tx, ty, exact_camera, exact_options);
        least += listing.listed && !listing.uncertain ? 1 : 0;
        most += listing.listed || listing.uncertain ? 1 : 0;
      }
    }
    entries += most;
    uncertain += most - least;
    ASSERT_GE(rasterizer.counts().tile_entries, least) << trial;
    ASSERT_LE(rasterizer.counts().tile_entries, most) << trial;

    // The pixels show which tiles list the splat.
    if (trial % 4 != 0) continue;
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const double dx = splat.x - (x + 0.5);
        const double dy = splat.y - (y + 0.5);
        const double exponent =
            0.5 * (splat.conic_xx * dx * dx + 2 * splat.conic_xy * dx * dy + splat.conic_yy * dy * dy);
        const double alpha = splat.opacity * std::exp(-exponent);
        const float shown = images.alpha[static_cast<std::size_t>(y * camera.width + x)];
        if (alpha < reference::kAlphaFloor * 0.9999) {
          ASSERT_EQ(shown, 0) << trial;
        } else if (alpha > reference::kAlphaFloor * 1.0001) {
          const auto listing = reference::tile_lists(splat, x / 16, y / 16, exact_camera, exact_options);
          if (options.box == BoxPolicy::ellipse && options.beta == 1) {
            // The brute-force oracle: no pixel that reaches 1/255 is lost.
            ASSERT_GT(shown, 0) << trial << ": pixel " << x << " " << y << " has alpha " << alpha;
          } else if (!listing.uncertain) {
            ASSERT_EQ(shown > 0, listing.listed) << trial << ": pixel " << x << " " << y;
          }
        }
      }
    }
  }
  EXPECT_TRUE(are_few(uncertain, entries, 0.002));
}

TEST(CompactBox, NoPixelOfOneStepIsLostAtBetaOne) { check_many_tiles(ellipse(1), some_of(4000), 11); }
TEST(CompactBox, HalfBetaCutsWholeTiles) { check_many_tiles(ellipse(0.5f), some_of(2000), 12); }
TEST(CompactBox, TheSquareCutsWholeTiles) { check_many_tiles(RasterOptions{}, some_of(2000), 13); }

TEST(CompactBox, SmallerBetaListsNoMore) {
  Numbers random(21);
  const Camera camera = flat_camera(150, 75);
  Threads threads(1);
  Rasterizer rasterizer(threads);
  std::vector<float> color(3 * 150 * 75);
  std::size_t last_total = 0;
  std::vector<SceneData> splats;
  for (int k = 0; k < some_of(600); ++k) splats.push_back(random_splat(random, 150, 75));
  std::vector<std::size_t> last(splats.size(), 0);
  for (const float beta : {0.01f, 0.2f, 0.5f, 0.8f, 1.0f}) {
    std::size_t total = 0;
    for (std::size_t k = 0; k < splats.size(); ++k) {
      rasterizer.forward(camera, splats[k].view(), ellipse(beta), color_only(color));
      EXPECT_GE(rasterizer.counts().tile_entries, last[k]);
      last[k] = rasterizer.counts().tile_entries;
      total += last[k];
    }
    EXPECT_GT(total, last_total);
    last_total = total;
  }
}

TEST(CompactBox, OpacityOfOneStepOrLessTouchesNoTile) {
  const Camera camera = flat_camera(64, 64);
  Threads threads(1);
  Rasterizer rasterizer(threads);
  std::vector<float> color(3 * 64 * 64);
  for (const float beta : {1.0f, 0.5f}) {
    for (const double opacity : {0.0, 1e-30, 0.001, 0.0039, static_cast<double>(kMinAlpha)}) {
      const SceneData scene = flat_splat(24.5, 24.5, 8, 5, 0.3, opacity);
      rasterizer.forward(camera, scene.view(), ellipse(beta), color_only(color));
      EXPECT_EQ(rasterizer.counts().tile_entries, 0u) << opacity;
      EXPECT_EQ(rasterizer.visible()[0], 0) << opacity;
      EXPECT_EQ(rasterizer.screen_radii()[0], 0) << opacity;
    }
    // Just above it, the tile of the centre pixel.
    const SceneData scene = flat_splat(24.5, 24.5, 8, 5, 0.3, 0.0041);
    rasterizer.forward(camera, scene.view(), ellipse(beta), color_only(color));
    EXPECT_EQ(rasterizer.counts().tile_entries, 1u);
  }
}

TEST(CompactBox, OpacityBelowZeroIsNotDrawnInAnyBox) {
  const Camera camera = flat_camera(64, 64);
  Threads threads(1);
  Rasterizer rasterizer(threads);
  std::vector<float> color(3 * 64 * 64);
  const SceneData scene = flat_splat(24.5, 24.5, 8, 5, 0.3, -1);
  for (const RasterOptions& options : {RasterOptions{}, ellipse(1)}) {
    rasterizer.forward(camera, scene.view(), options, color_only(color));
    EXPECT_EQ(rasterizer.counts().tile_entries, 0u);
    EXPECT_EQ(rasterizer.visible()[0], 0);
  }
}

TEST(CompactBox, ASplatBetweenPixelCentresOfTwoTilesMayTouchNeither) {
  // Tiles are spanned by pixel centres: x in [0.5,15.5] and [16.5,31.5]. A faint dot at x = 16 reaches none of them.
  const Camera camera = flat_camera(32, 16);
  Threads threads(1);
  Rasterizer rasterizer(threads);
  std::vector<float> color(3 * 32 * 16);
  RasterOptions options = ellipse(1);
  SceneData scene = flat_splat(16, 8.5, 0.001, 0.001, 0, 0.005);
  // Level 2·ln(0.005·255) = 0.486 with variance 0.3: reach 0.38 px < 0.5.
  rasterizer.forward(camera, scene.view(), options, color_only(color));
  EXPECT_EQ(rasterizer.counts().tile_entries, 0u);
  scene.opacities[0] = 0.01f;  // level 1.87: reach 0.75 px
  rasterizer.forward(camera, scene.view(), options, color_only(color));
  EXPECT_EQ(rasterizer.counts().tile_entries, 2u);
}

TEST(CompactBox, DegenerateGaussiansAreHarmless) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  const Camera camera = flat_camera(50, 40);
  // Mean, covariance, opacity; a regular Gaussian is drawn behind each.
  struct Odd {
    float mean[3];
    float covariance[6];
    float opacity;
  };
  const std::vector<Odd> odd = {
      {{nan, 0, 1}, {4, 0, 0, 4, 0, 0}, 0.5f},
      {{20, 20, nan}, {4, 0, 0, 4, 0, 0}, 0.5f},
      {{infinity, 20, 1}, {4, 0, 0, 4, 0, 0}, 0.5f},
      {{20, 20, infinity}, {4, 0, 0, 4, 0, 0}, 0.5f},
      {{20, 20, -infinity}, {4, 0, 0, 4, 0, 0}, 0.5f},
      {{20, 20, 1}, {nan, 0, 0, 4, 0, 0}, 0.5f},
      {{20, 20, 1}, {4, nan, nan, 4, nan, nan}, 0.5f},
      {{20, 20, 1}, {infinity, 0, 0, 4, 0, 0}, 0.5f},
      {{20, 20, 1}, {infinity, infinity, infinity, infinity, infinity, infinity}, 0.5f},
      {{20, 20, 1}, {1e38f, 0, 0, 1e38f, 0, 0}, 0.5f},
      {{20, 20, 1}, {1e30f, 1e30f, 0, 1e30f, 0, 0}, 0.5f},
      {{20, 20, 1}, {1e18f, 0, 0, 1e18f, 0, 0}, 0.5f},
      {{20, 20, 1}, {-50, 0, 0, -50, 0, 0}, 0.5f},
      {{20, 20, 1}, {-0.55f, 0, 0, -0.55f, 0, 0}, 0.5f},
      {{20, 20, 1}, {1, 5, 0, 1, 0, 0}, 0.5f},
      {{1e30f, 1e30f, 1}, {4, 0, 0, 4, 0, 0}, 0.5f},
      {{-1e9f, 3e9f, 1}, {4, 0, 0, 4, 0, 0}, 0.5f},
      {{20, 20, 1}, {4, 0, 0, 4, 0, 0}, nan},
      {{20, 20, 1}, {4, 0, 0, 4, 0, 0}, infinity},
  };
  Threads threads(2);
  for (const bool compensate : {false, true}) {
    for (const float low_pass : {0.3f, 0.0f}) {
      for (const RasterOptions base : {ellipse(1), ellipse(0.5f), RasterOptions{}}) {
        RasterOptions options = base;
        options.compensate_opacity = compensate;
        options.low_pass = low_pass;
        SceneData sane = flat_splat(24.5, 22.5, 6, 4, 0.5, 0.8);
        sane.means[2] = 2;
        sane.means[0] *= 2;
        sane.means[1] *= 2;
        for (const std::size_t k : {0u, 1u, 3u}) sane.covariances[k] *= 4;
        Rasterizer rasterizer(threads);
        for (std::size_t k = 0; k < odd.size(); ++k) {
          SceneData scene = sane;
          scene.count = 2;
          scene.means.insert(scene.means.end(), std::begin(odd[k].mean), std::end(odd[k].mean));
          scene.covariances.insert(scene.covariances.end(), std::begin(odd[k].covariance), std::end(odd[k].covariance));
          scene.opacities.push_back(odd[k].opacity);
          scene.colors.insert(scene.colors.end(), {1, 1, 1});
          ImageData images(camera, 0);
          rasterizer.forward(camera, scene.view(), options, images.view());
          for (const float value : images.color) ASSERT_TRUE(std::isfinite(value)) << "odd Gaussian " << k;
          for (const float value : images.alpha) ASSERT_TRUE(value >= 0 && value <= 1) << "odd Gaussian " << k;
          const ImageGradientData weights(camera, 0, 4, {});
          GradientData gradients(scene);
          rasterizer.backward(scene.view(), weights.view(), gradients.view());
          // The degenerate Gaussian does not affect the gradient of the regular one.
          for (std::size_t axis = 0; axis < 3; ++axis)
            ASSERT_TRUE(std::isfinite(gradients.means[axis])) << "odd Gaussian " << k;
          ASSERT_TRUE(std::isfinite(gradients.opacities[0])) << "odd Gaussian " << k;
          if (rasterizer.visible()[1] == 0) {
            for (std::size_t axis = 3; axis < 6; ++axis) ASSERT_EQ(gradients.means[axis], 0) << "odd Gaussian " << k;
          }
          if (k <= 8 || k >= 13) {
            EXPECT_EQ(rasterizer.visible()[1], 0)
                << "odd Gaussian " << k << (options.box == BoxPolicy::ellipse ? ", ellipse" : ", square");
          }
        }
      }
    }
  }
}

// Rounding makes their covariances in the image negative definite, or their conics saddles.
TEST(CompactBox, NeedlesWithoutALowPassGiveNoValuesBeyondThoseOfSplats) {
  Camera camera;
  camera.width = camera.height = 64;
  camera.fx = camera.fy = 1500;
  camera.cx = camera.cy = 32;
  Threads threads(1);
  Rasterizer rasterizer(threads);
  Numbers random(7);
  for (int group = 0; group < 20; ++group) {
    SceneData scene;
    for (scene.count = 0; scene.count < 100; ++scene.count) {
      const auto z = static_cast<float>(random.uniform(0.5, 5.5));
      const glm::vec3 mean(static_cast<float>(random.uniform(-0.02, 0.02)) * z,
                           static_cast<float>(random.uniform(-0.02, 0.02)) * z, z);
      const glm::vec3 along = 5.0f * glm::normalize(mean);
      scene.means.insert(scene.means.end(), {mean.x, mean.y, mean.z});
      scene.covariances.insert(scene.covariances.end(), {along.x * along.x, along.x * along.y, along.x * along.z,
                                                         along.y * along.y, along.y * along.z, along.z * along.z});
      scene.opacities.push_back(0.5f);
      scene.colors.insert(scene.colors.end(), {1, 1, 1});
    }
    for (const RasterOptions base : {ellipse(1), RasterOptions{}}) {
      RasterOptions options = base;
      options.low_pass = 0;
      ImageData images(camera, 0);
      rasterizer.forward(camera, scene.view(), options, images.view());
      for (const float value : images.color) ASSERT_TRUE(value >= 0 && value <= 1.001f) << value;
      for (const float value : images.alpha) ASSERT_TRUE(value >= 0 && value <= 1) << value;
    }
  }
}

TEST(CompactBox, ZeroScalesGiveAPixelWithALowPassAndNothingWithout) {
  const Camera camera = flat_camera(40, 40);
  SceneData scene;
  scene.count = 1;
  scene.means = {20.5f, 20.5f, 1};
  scene.scales = {0, 0, 0};
  scene.rotations = {1, 0, 0, 0};
  scene.opacities = {0.9f};
  scene.colors = {1, 1, 1};
  Threads threads(1);
  Rasterizer rasterizer(threads);
  for (const RasterOptions base : {ellipse(1), RasterOptions{}}) {
    RasterOptions options = base;
    ImageData images(camera, 0);
    rasterizer.forward(camera, scene.view(), options, images.view());
    EXPECT_NEAR(static_cast<double>(images.alpha[20 * 40 + 20]), 0.9, 1e-6);
    options.low_pass = 0;
    rasterizer.forward(camera, scene.view(), options, images.view());
    EXPECT_EQ(rasterizer.counts().tile_entries, 0u);
    for (const float alpha : images.alpha) EXPECT_EQ(alpha, 0);
  }
}

// Its determinant is above 0, but the inverse of its covariance overflows.
TEST(CompactBox, AVanishingGaussianWithoutLowPassIsNotDrawn) {
  const Camera camera = flat_camera(40, 40);
  SceneData scene;
  scene.count = 1;
  scene.means = {20.5f, 20.5f, 1};
  scene.covariances = {8e-21f, 0, 0, 8e-21f, 0, 0};
  scene.opacities = {0.9f};
  scene.colors = {1, 1, 1};
  Threads threads(1);
  Rasterizer rasterizer(threads);
  ImageData images(camera, 0);
  const ImageGradientData weights(camera, 0, 4, {});
  for (const bool compensate : {false, true}) {
    for (const RasterOptions base : {ellipse(1), RasterOptions{}}) {
      RasterOptions options = base;
      options.compensate_opacity = compensate;
      options.low_pass = 0;
      rasterizer.forward(camera, scene.view(), options, images.view());
      EXPECT_EQ(rasterizer.counts().tile_entries, 0u);
      GradientData gradients(scene);
      rasterizer.backward(scene.view(), weights.view(), gradients.view());
      for (const float gradient : gradients.means) EXPECT_EQ(gradient, 0);
      for (const float gradient : gradients.covariances) EXPECT_EQ(gradient, 0);
      EXPECT_EQ(gradients.opacities[0], 0);
    }
  }
}

TEST(CompactBox, QuaternionsAreNormalisedUnlessTheirSquareIsOutOfRange) {
  const Camera camera = flat_camera(40, 40);
  SceneData scene;
  scene.count = 1;
  scene.means = {20.5f, 20.5f, 1};
  scene.scales = {2, 3, 4};
  scene.opacities = {0.9f};
  scene.colors = {1, 1, 1};
  Threads threads(1);
  Rasterizer rasterizer(threads);
  ImageData unit(camera, 0), images(camera, 0);
  const ImageGradientData weights(camera, 0, 4, {});
  for (const float length : {1.0f, 0.0f, 1e-45f, 1e-30f, 1e-22f, 9e-19f, 1.2e-18f, 9e18f, 1.2e19f, 1e30f}) {
    scene.rotations = {0.1f * length, 0.7f * length, -0.5f * length, 0.5f * length};
    rasterizer.forward(camera, scene.view(), RasterOptions{}, length == 1 ? unit.view() : images.view());
    const bool drawn = length > 1e-18f && length < 1e19f;
    EXPECT_EQ(rasterizer.visible()[0] != 0, drawn) << length;
    EXPECT_EQ(reference::render(scene.reference(), reference_camera(camera), reference_options({})).visible[0] != 0,
              drawn)
        << length;
    std::vector<std::int32_t> radii(1);
    visible_radii(camera, scene.view(), {}, radii, threads);
    EXPECT_EQ(radii[0] > 0, drawn) << length;
    if (drawn && length != 1) {
      for (std::size_t p = 0; p < unit.alpha.size(); ++p) ASSERT_NEAR(images.alpha[p], unit.alpha[p], 1e-5f) << length;
    }
    GradientData gradients(scene);
    rasterizer.backward(scene.view(), weights.view(), gradients.view());
    for (const float gradient : gradients.rotations) {
      EXPECT_TRUE(std::isfinite(gradient) && (drawn || gradient == 0)) << length;
    }
  }
}

}  // namespace
}  // namespace splatboost::test

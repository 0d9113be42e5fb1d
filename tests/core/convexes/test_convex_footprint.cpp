// SPDX-License-Identifier: Apache-2.0
// The compact box of random convexes: at β = 1 no pixel with α ≥ 1/255 is lost, and few tiles are listed that the bound
// does not require.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "convexes/convex_frame.h"
#include "splatboost/errors.h"
#include "support/compare.h"
#include "support/convex_scenes.h"
#include "support/instruction_sets.h"

namespace splatboost::test {
namespace {

/// 3 × 3 tiles, the last of them cut off by the image border.
Camera small_camera() {
  Camera camera = oblique_camera(43, 38);
  camera.cx = 20;
  camera.cy = 18;
  return camera;
}

/// Convexes of all shapes: thin and thick, soft and sharp, faint and opaque, within the image and far outside.
ConvexSceneData any_convexes(const Camera& camera, std::size_t count, int points, std::uint64_t seed) {
  ConvexSceneSpec spec;
  spec.count = count;
  spec.points_per_convex = points;
  spec.colors = true;
  spec.smallest = 0.3;
  spec.largest = 60;
  spec.soft = 0.02;
  spec.steep = 50;
  spec.behind = 0;
  ConvexSceneData scene = random_convexes(camera, spec, seed);
  Numbers random(seed + 1);
  const auto width = static_cast<std::size_t>(3 * points);
  for (std::size_t i = 0; i < count; ++i) {
    if (random.uniform(0, 1) < 0.2) scene.opacities[i] = random.real(1.0 / 255, 4.0 / 255);
    if (random.uniform(0, 1) < 0.3) {  // thin
      const float flat = random.real(0.002, 0.05);
      for (std::size_t k = width * i; k < width * (i + 1); k += 3) {
        scene.points[k] = scene.points[width * i] + flat * (scene.points[k] - scene.points[width * i]);
      }
    }
  }
  return scene;
}

/// A convex in double precision as in the reference: terms z·δ·L at a pixel, and whether α reaches 1/255.
struct Exact {
  std::vector<std::array<double, 3>> edges;
  double limit = 0, steepness = 0, opacity = 0;
  bool drawn = false;

  Exact(const ConvexSceneData& scene, std::size_t i, const Camera& camera) {
    const auto n = static_cast<std::size_t>(scene.points_per_convex);
    const reference::Camera exact = reference_camera(camera);
    std::vector<double> u(n), v(n);
    double depth = 0, centre_x = 0, centre_y = 0;
    for (std::size_t p = 0; p < n; ++p) {
      double at[3];
      for (std::size_t row = 0; row < 3; ++row) {
        at[row] = exact.translation[row];
        for (std::size_t c = 0; c < 3; ++c)
          at[row] += exact.rotation[row][c] * static_cast<double>(scene.points[(i * n + p) * 3 + c]);
      }
      if (at[2] <= 0) return;
      centre_x += at[0] / static_cast<double>(n);
      centre_y += at[1] / static_cast<double>(n);
      depth += at[2] / static_cast<double>(n);
      u[p] = exact.fx * at[0] / at[2] + exact.cx;
      v[p] = exact.fy * at[1] / at[2] + exact.cy;
    }
    for (std::size_t p = 0; p < n; ++p) {
      const double x = u[p] - exact.fx * centre_x / depth - exact.cx, y = v[p] - exact.fy * centre_y / depth - exact.cy;
      if (std::hypot(x, y) > 9999) return;
    }
    const double scale = depth * static_cast<double>(scene.smoothness[i]);
    steepness = depth * static_cast<double>(scene.sharpness[i]);
    opacity = static_cast<double>(scene.opacities[i]);
    if (depth <= 0.2 || opacity <= reference::kAlphaFloor) return;
    for (std::size_t a = 0; a < n; ++a) {
      for (std::size_t b = 0; b < n; ++b) {
        const double x = v[b] - v[a], y = u[a] - u[b];
        bool is_edge = a != b;
        for (std::size_t c = 0; c < n && is_edge; ++c) {
          if (c == a || c == b) continue;
          is_edge = x * (u[c] - u[a]) + y * (v[c] - v[a]) < 0;
        }
        if (is_edge) edges.push_back({scale * x, scale * y, -scale * (x * u[a] + y * v[a])});
      }
    }
    limit = std::log(opacity / reference::kAlphaFloor - 1) / steepness;
    drawn = edges.size() >= 3;
  }
  bool reaches(double x, double y) const {
    double greatest = -1e300;
    for (const auto& e : edges) greatest = std::max(greatest, e[0] * x + e[1] * y + e[2]);
    if (greatest > limit) return false;  // φ is at least as large
    double sum = 0;
    for (const auto& e : edges) sum += std::exp(e[0] * x + e[1] * y + e[2] - greatest);
    return opacity / (1 + std::exp(steepness * (greatest + std::log(sum)))) >= reference::kAlphaFloor;
  }
};

TEST(ConvexFootprint, LosesNothingAtBetaOne) {
  const Camera camera = small_camera();
  Threads threads(2);
  std::size_t drawn = 0, checked = 0, at_threshold = 0;
  for (const int points : {3, 6, 8}) {
    const ConvexSceneData scene =
        any_convexes(camera, points == 6 ? 60000 : 20000, points, static_cast<std::uint64_t>(points));
    ConvexFrame frame;
    frame.camera = camera;
    frame.options.box = ConvexBox::compact;
    frame.primitives = scene.count;
    frame.tiles_x = camera.tiles_x();
    frame.tiles_y = camera.tiles_y();
    project_convexes(frame, scene.view(), threads);
    for (std::size_t i = 0; i < scene.count; ++i) {
      const Exact exact(scene, i, camera);
      if (!exact.drawn) continue;
      ++drawn;
      bool listed[9] = {};
      const TileListing& listing = frame.listings[i];
      for (std::uint32_t t = 0; t < listing.tiles; ++t) {
        listed[frame.listed_tiles[i / kProjectGrain][listing.first + t]] = true;
      }
      for (int tile = 0; tile < 9; ++tile) {
        if (listed[tile]) continue;
        const int x0 = tile % 3 * kTileSize, y0 = tile / 3 * kTileSize;
        const int x1 = std::min(camera.width, x0 + kTileSize), y1 = std::min(camera.height, y0 + kTileSize);
        for (int y = y0; y < y1; ++y) {
          for (int x = x0; x < x1; ++x) {
            ++checked;
            if (!exact.reaches(x + 0.5, y + 0.5)) continue;
            // Within rounding of the threshold, single precision may decide differently.
            ++at_threshold;
            Exact fainter = exact;
            fainter.opacity *= 1 - 1e-4;
            ASSERT_FALSE(fainter.reaches(x + 0.5, y + 0.5))
                << "convex " << i << " of " << points << " points, pixel " << x << ", " << y;
          }
        }
      }
    }
  }
  EXPECT_GT(drawn, 80000u);
  EXPECT_GT(checked, 10000000u);
  EXPECT_LT(at_threshold, 20u);
}

TEST(ConvexFootprint, ListsLittleThatTheBoundDoesNotAskFor) {
  const Camera camera = small_camera();
  Threads threads(1);
  ConvexRasterizer rasterizer(threads);
  const ConvexSceneData scene = any_convexes(camera, 3000, 6, 77);
  std::vector<float> color(3 * 43 * 38);
  for (const float beta : {1.0f, 0.5f}) {
    ConvexOptions options;
    options.box = ConvexBox::compact;
    options.beta = beta;
    rasterizer.forward(camera, scene.view(), options, color);
    const auto expected = reference::render(scene.reference(), reference_camera(camera), reference_options(options));
    const auto listed = static_cast<double>(rasterizer.counts().tile_entries);
    EXPECT_GE(listed,
              static_cast<double>(expected.tile_entries) - 0.5 * static_cast<double>(expected.uncertain_entries));
    EXPECT_LE(listed, 1.05 * static_cast<double>(expected.tile_entries));
  }
}

TEST(ConvexFootprint, SmallerBetaListsLess) {
  const Camera camera = oblique_camera(160, 120);
  Threads threads(1);
  ConvexRasterizer rasterizer(threads);
  const ConvexSceneData scene = any_convexes(camera, 300, 6, 5);
  std::vector<float> color(3 * 160 * 120);
  std::size_t before = std::numeric_limits<std::size_t>::max();
  for (const float beta : {1.0f, 0.7f, 0.4f, 0.1f}) {
    ConvexOptions options;
    options.box = ConvexBox::compact;
    options.beta = beta;
    rasterizer.forward(camera, scene.view(), options, color);
    EXPECT_LT(rasterizer.counts().tile_entries, before) << beta;
    before = rasterizer.counts().tile_entries;
  }
}

TEST(ConvexRasterizer, SameBytesForAnyNumberOfThreads) {
  const Camera camera = oblique_camera(160, 120);
  const ConvexSceneData scene = any_convexes(camera, 2000, 6, 6);
  ConvexOptions options;
  options.box = ConvexBox::compact;
  const std::vector<float> up = numbers(3 * 160 * 120, -1, 1, 3);
  std::vector<std::vector<float>> colors;
  std::vector<ConvexGradientData> gradients;
  for (const int count : {1, 3}) {
    Threads threads(count);
    ConvexRasterizer rasterizer(threads);
    colors.emplace_back(3 * 160 * 120);
    rasterizer.forward(camera, scene.view(), options, colors.back());
    gradients.emplace_back(scene);
    rasterizer.backward(scene.view(), up, {}, gradients.back().view());
  }
  EXPECT_EQ(colors[0], colors[1]);
  for (std::size_t k = 0; k < gradients[0].all().size(); ++k) EXPECT_EQ(*gradients[0].all()[k], *gradients[1].all()[k]);
}

TEST(ConvexRasterizer, AllInstructionSetsAgree) {
  const Camera camera = oblique_camera(67, 50);
  ConvexSceneSpec spec;
  spec.count = 30;
  const ConvexSceneData scene = random_convexes(camera, spec, 6);
  ConvexOptions options;
  options.box = ConvexBox::compact;
  const auto expected = reference::render(scene.reference(), reference_camera(camera), reference_options(options));
  const ImageGradientData up(camera, 0, 3, expected.uncertain);
  std::vector<float> first;
  std::vector<std::int32_t> first_counts;
  for_each_target([&] {
    Threads threads(1);
    ConvexRasterizer rasterizer(threads);
    std::vector<float> color(3 * 67 * 50);
    rasterizer.forward(camera, scene.view(), options, color);
    EXPECT_TRUE(is_close(color, expected.color, {.relative = 2e-5, .scale = 2e-6, .absolute = 3e-6, .l2 = 3e-6},
                         expected.uncertain));
    ConvexGradientData gradients(scene);
    rasterizer.backward(scene.view(), up.color, up.alpha, gradients.view());
    std::vector<std::uint8_t> flagged(67 * 50);
    for (std::size_t p = 0; p < flagged.size(); ++p) flagged[p] = expected.uncertain[p] == 0 ? 1 : 0;
    std::vector<std::int32_t> counts(scene.count, 0);
    rasterizer.count_flagged(flagged, counts);
    if (first.empty()) {
      first = gradients.points;
      first_counts = counts;
    }
    EXPECT_EQ(counts, first_counts);
    EXPECT_TRUE(is_close(gradients.points, std::vector<double>(first.begin(), first.end()),
                         {.relative = 5e-4, .scale = 5e-5, .absolute = 0, .l2 = 5e-5}));
  });
}

TEST(ConvexRasterizer, RefusesWhatDoesNotFit) {
  const Camera camera = small_camera();
  Threads threads(1);
  ConvexRasterizer rasterizer(threads);
  const ConvexSceneData scene = any_convexes(camera, 3, 6, 6);
  std::vector<float> color(3 * 43 * 38);
  std::vector<std::int32_t> counts(3);
  EXPECT_THROW(rasterizer.count_flagged(std::vector<std::uint8_t>(43 * 38), counts), ArgumentError);
  const auto refused = [&](const auto& change) {
    Convexes convexes = scene.view();
    ConvexOptions options;
    change(convexes, options);
    EXPECT_THROW(rasterizer.forward(camera, convexes, options, color), ArgumentError);
  };
  refused([](Convexes& c, ConvexOptions&) { c.points_per_convex = 5; });
  refused([](Convexes& c, ConvexOptions&) { c.points_per_convex = 9; });
  refused([](Convexes& c, ConvexOptions&) { c.smoothness = {}; });
  refused([](Convexes& c, ConvexOptions&) { c.colors = {}; });
  refused([&](Convexes& c, ConvexOptions&) { c.sh_dc = c.colors; });
  refused([](Convexes&, ConvexOptions& o) { o.beta = 0; });
  refused([](Convexes&, ConvexOptions& o) { o.beta = 1.5f; });
  refused([](Convexes&, ConvexOptions& o) { o.pixel_size = 0; });
  refused([](Convexes&, ConvexOptions& o) { o.near_plane = -1; });
  rasterizer.forward(camera, scene.view(), {}, color);
  EXPECT_THROW(rasterizer.count_flagged(std::vector<std::uint8_t>(5), counts), ArgumentError);
  ConvexGradientData gradients(scene);
  ConvexGradients out = gradients.view();
  out.smoothness = out.smoothness.subspan(1);
  EXPECT_THROW(rasterizer.backward(scene.view(), color, {}, out), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test

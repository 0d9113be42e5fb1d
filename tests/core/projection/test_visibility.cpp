// SPDX-License-Identifier: Apache-2.0
// Visibility in a view, against the rasterizer.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include "splatboost/errors.h"
#include "splatboost/visibility.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

TEST(Visibility, RadiiAreTheRasterizersOwn) {
  Threads threads(2);
  const Camera camera = oblique_camera(70, 50);
  for (const bool covariances : {false, true}) {
    SceneSpec spec;
    spec.count = 3000;
    spec.colors = true;
    spec.covariances = covariances;
    SceneData scene = random_scene(camera, spec, 11);
    for (std::size_t i = 0; i < scene.means.size() / 2; ++i) scene.means[i] *= 3.0f;  // many outside of the image
    RasterOptions options;
    options.low_pass = 0.1f;
    Rasterizer rasterizer(threads);
    std::vector<float> color(3 * 70 * 50);
    rasterizer.forward(camera, scene.view(), options, color_only(color));
    std::vector<std::int32_t> radii(spec.count, -1);
    visible_radii(camera, scene.view(), options, radii, threads);
    std::size_t seen = 0, differ = 0;
    for (std::size_t i = 0; i < spec.count; ++i) {
      seen += radii[i] > 0;
      differ += radii[i] != rasterizer.screen_radii()[i];
    }
    EXPECT_GT(seen, 500u);
    EXPECT_LT(seen, spec.count - 500);
    // Other instructions round differently: a radius just below a whole pixel may become one larger.
    EXPECT_LE(differ, 3u) << covariances;
  }
}

TEST(Visibility, ImagesMayBeOfAnySize) {
  Threads threads(1);
  const SceneData scene = random_scene(oblique_camera(20, 20), {.count = 20}, 12);
  std::vector<std::int32_t> small(20), large(20);
  visible_radii(oblique_camera(20, 20), scene.view(), {}, small, threads);
  Camera camera = oblique_camera(20, 20);
  camera.width = camera.height = std::numeric_limits<int>::max();
  visible_radii(camera, scene.view(), {}, large, threads);
  for (std::size_t i = 0; i < 20; ++i) {
    if (small[i] > 0) {
      EXPECT_GT(large[i], 0) << i;
    }
  }
  EXPECT_GT(*std::max_element(small.begin(), small.end()), 0);
}

TEST(Visibility, MarksWhatLiesBeyondTheNearPlane) {
  Threads threads(2);
  const Camera camera = oblique_camera(20, 20);
  const glm::vec3 forward(camera.camera_from_world[0][2], camera.camera_from_world[1][2],
                          camera.camera_from_world[2][2]);
  std::vector<float> means;
  for (const float depth : {0.19f, 0.21f, -1.0f, 100.0f}) {
    const glm::vec3 p = camera.centre() + depth * forward;
    means.insert(means.end(), {p.x, p.y, p.z});
  }
  std::vector<std::uint8_t> visible(4, 9);
  mark_visible(camera, means, 0.2f, visible, threads);
  EXPECT_EQ(visible, (std::vector<std::uint8_t>{0, 1, 0, 1}));
}

TEST(Visibility, RefusesWrongShapes) {
  Threads threads(1);
  const Camera camera = oblique_camera(20, 20);
  const std::vector<float> means(6);
  std::vector<std::uint8_t> visible(3);
  EXPECT_THROW(mark_visible(camera, means, 0.2f, visible, threads), ArgumentError);
  visible.resize(2);
  EXPECT_THROW(mark_visible(camera, means, 0.0f, visible, threads), ArgumentError);
  EXPECT_THROW(mark_visible(Camera{}, means, 0.2f, visible, threads), ArgumentError);
  Gaussians gaussians;
  gaussians.count = 2;
  gaussians.means = means;
  std::vector<std::int32_t> radii(2);
  EXPECT_THROW(visible_radii(camera, gaussians, {}, radii, threads), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test

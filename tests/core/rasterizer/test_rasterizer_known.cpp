// SPDX-License-Identifier: Apache-2.0
// The rasterizer on scenes whose image is known without a reference.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include <glm/geometric.hpp>

#include "splatboost/rasterizer.h"
#include "support/scenes.h"
#include "support/tested_rasterizer.h"

namespace splatboost::test {
namespace {

// Two clamped splats reach the limit exactly in decimals; in the model's floats (1 − 0.99f)² < 1e-4f.
TEST(RasterizerKnown, ASecondOpaqueSplatSaturates) {
  Camera camera = oblique_camera(8, 8);
  camera.camera_from_world = glm::mat4(1);
  camera.cx = camera.cy = 3.5f;
  SceneData scene;
  scene.count = 3;
  scene.means = {0, 0, 2, 0, 0, 3, 0, 0, 4};
  for (int i = 0; i < 3; ++i) {
    for (const float v : {1.f, 0.f, 0.f, 1.f, 0.f, 1.f}) scene.covariances.push_back(v);
    scene.opacities.push_back(1);
    for (int c = 0; c < 3; ++c) scene.colors.push_back(static_cast<float>(i == c));
  }
  Threads threads(1);
  Rasterizer rasterizer(threads);
  ImageData images(camera, 0);
  rasterizer.forward(camera, scene.view(), RasterOptions{}, images.view());
  const std::size_t centre = 3 * 8 + 3;
  EXPECT_FLOAT_EQ(images.color[centre], 0.99f);
  EXPECT_EQ(images.color[64 + centre], 0);
  EXPECT_EQ(images.color[128 + centre], 0);
  EXPECT_FLOAT_EQ(images.alpha[centre], 0.99f);
}

TEST(RasterizerKnown, NoGaussiansGiveTheBackground) {
  const Camera camera = oblique_camera(21, 5);
  SceneData scene;
  Threads threads(2);
  Rasterizer rasterizer(threads);
  for (const BoxPolicy box : {BoxPolicy::square, BoxPolicy::ellipse}) {
    RasterOptions options;
    options.background = {0.3f, 0.1f, 0.7f};
    options.box = box;
    ImageData images(camera, 0);
    rasterizer.forward(camera, scene.view(), options, images.view());
    for (std::size_t k = 0; k < images.color.size(); ++k)
      EXPECT_EQ(images.color[k], options.background[static_cast<int>(k / 105)]);
    for (std::size_t k = 0; k < 105; ++k) EXPECT_EQ(images.alpha[k], 0);
    for (std::size_t k = 0; k < 105; ++k) EXPECT_EQ(images.inverse_depth[k], 0);
    EXPECT_EQ(rasterizer.counts().visible, 0u);
    EXPECT_EQ(rasterizer.counts().tile_entries, 0u);
    EXPECT_TRUE(rasterizer.visible().empty());
    GradientData gradients(scene);
    const ImageGradientData weights(camera, 0, 3, {});
    rasterizer.backward(scene.view(), weights.view(), gradients.view());
  }
}

TEST(RasterizerKnown, ANeedleOnAViewingRayIsAPointWhereverThePrincipalPointIs) {
  for (const float cx : {500.0f, 100.0f, 0.0f, -200.0f}) {
    Camera camera;
    camera.width = 1000;
    camera.height = 16;
    camera.fx = camera.fy = 500;
    camera.cx = cx;
    camera.cy = 8;
    SceneData scene;
    scene.count = 1;
    const glm::vec3 mean(4 * (900.5f - cx) / 500, 0, 4), along = 0.5f * glm::normalize(mean);
    scene.means = {mean.x, mean.y, mean.z};
    scene.covariances = {along.x * along.x, 0, along.x * along.z, 1e-6f, 0, along.z * along.z};
    scene.opacities = {1};
    scene.colors = {1, 1, 1};
    Threads threads(1);
    Rasterizer rasterizer(threads);
    ImageData images(camera, 0);
    RasterOptions options;
    rasterizer.forward(camera, scene.view(), options, images.view());
    const auto row = std::span(images.alpha).subspan(8 * 1000, 1000);
    EXPECT_LT(std::ranges::count_if(row, [](float alpha) { return alpha > 0.1f; }), 4) << cx;
    EXPECT_GT(row[900], 0.6f) << cx;
  }
}

// 3DGS cuts opaque splats at 3σ; the compact box at β = 1 loses no pixel that reaches 1/255.
TEST(RasterizerKnown, TheEllipseShowsTheRimThatTheSquareCuts) {
  Camera camera;
  camera.width = camera.height = 96;
  camera.fx = camera.fy = 100;
  camera.cx = camera.cy = 33.0f;
  SceneData scene;
  scene.count = 1;
  scene.means = {0, 0, 1};
  scene.covariances = {24.7e-4f, 0, 0,
                       24.7e-4f, 0, 0};  // 25 px² with the low-pass: σ = 5, 3σ ends at 48, the rim at 49.6
  scene.opacities = {1};
  scene.colors = {1, 1, 1};
  Threads threads(1);
  Rasterizer rasterizer(threads);
  ImageData images(camera, 0);
  const std::size_t beyond = 32 * 96 + 48;  // centre at 48.5, in the tile that starts at 48: alpha 0.0082
  RasterOptions options;
  rasterizer.forward(camera, scene.view(), options, images.view());
  EXPECT_EQ(images.alpha[beyond], 0);
  options.box = BoxPolicy::ellipse;
  rasterizer.forward(camera, scene.view(), options, images.view());
  EXPECT_NEAR(static_cast<double>(images.alpha[beyond]), std::exp(-0.5 * (15.5 * 15.5 + 0.25) / 25), 1e-5);
  options.beta = 0.5f;
  rasterizer.forward(camera, scene.view(), options, images.view());
  EXPECT_EQ(images.alpha[beyond], 0);
}

}  // namespace
}  // namespace splatboost::test

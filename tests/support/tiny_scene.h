// SPDX-License-Identifier: Apache-2.0
/// @file A scene small enough to train in a test: cameras on a ring around coloured blobs.
#pragma once

#include <cmath>

#include "splatboost/random.h"
#include "splatboost/rasterizer.h"
#include "support/looking_camera.h"
#include "trainer/dataset/scene.h"

namespace splatboost::testing {

/// Views of `blobs` random Gaussians, with `points` sparse points near them.
inline Scene tiny_scene(const Threads& threads, int views = 6, int width = 48, int height = 40, int blobs = 60,
                        int points = 40) {
  const RandomStream random(7, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  const auto n = static_cast<std::size_t>(blobs);
  std::vector<float> means(3 * n), scales(3 * n), rotations(4 * n, 0.0f), opacities(n), colors(3 * n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      means[3 * i + c] = static_cast<float>(random.uniform(next++) * 2 - 1);
      scales[3 * i + c] = static_cast<float>(0.03 + 0.12 * random.uniform(next++));
      colors[3 * i + c] = static_cast<float>(random.uniform(next++));
    }
    rotations[4 * i] = 1;
    opacities[i] = static_cast<float>(0.5 + 0.45 * random.uniform(next++));
  }
  Gaussians gaussians;
  gaussians.count = n;
  gaussians.means = means;
  gaussians.scales = scales;
  gaussians.rotations = rotations;
  gaussians.opacities = opacities;
  gaussians.colors = colors;

  Scene scene;
  Rasterizer rasterizer(threads);
  for (int v = 0; v < views; ++v) {
    const double angle = 6.283185307179586 * v / views;
    View view;
    view.name = "view_" + std::to_string(v) + ".png";
    view.camera =
        camera_looking_at_origin({4 * std::cos(angle), -0.8 + 0.3 * (v % 2), 4 * std::sin(angle)}, width, height);
    std::vector<float> image(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    RasterImages images;
    images.color = image;
    rasterizer.forward(view.camera, gaussians, RasterOptions{}, images);
    for (const float value : image) {
      view.color.push_back(static_cast<std::uint8_t>(std::lround(255 * std::fmin(std::fmax(value, 0.0f), 1.0f))));
    }
    (v % 4 == 3 ? scene.test : scene.train).push_back(std::move(view));
  }
  for (std::size_t i = 0; i < static_cast<std::size_t>(points); ++i) {
    const std::size_t blob = i % n;
    for (std::size_t c = 0; c < 3; ++c) {
      scene.points.positions.push_back(means[3 * blob + c] + static_cast<float>(0.05 * random.normal(next++)));
      scene.points.colors.push_back(static_cast<std::uint8_t>(255 * colors[3 * blob + c]));
    }
  }
  scene.extent = camera_extent(scene.train);
  return scene;
}

}  // namespace splatboost::testing

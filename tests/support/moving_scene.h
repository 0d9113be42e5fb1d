// SPDX-License-Identifier: Apache-2.0
/// @file A moving scene small enough to train in a test: blobs, half of which slide along y.
#pragma once

#include <cmath>

#include "support/tiny_scene.h"

namespace splatboost::testing {

inline constexpr float kSlide = 0.7f;  ///< distance from time 0 to time 1

/// Ground-truth image of the scene at a time.
inline std::vector<std::uint8_t> moving_truth(const Camera& camera, float time, const Threads& threads,
                                              int blobs = 40) {
  const RandomStream random(11, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  const auto n = static_cast<std::size_t>(blobs);
  std::vector<float> means(3 * n), scales(3 * n), rotations(4 * n, 0.0f), opacities(n, 0.9f), colors(3 * n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      means[3 * i + c] = static_cast<float>(random.uniform(next++) * 2 - 1);
      scales[3 * i + c] = static_cast<float>(0.06 + 0.1 * random.uniform(next++));
      colors[3 * i + c] = static_cast<float>(random.uniform(next++));
    }
    rotations[4 * i] = 1;
    if (means[3 * i] > 0) means[3 * i + 1] += kSlide * (time - 0.5f);
  }
  Gaussians gaussians;
  gaussians.count = n;
  gaussians.means = means;
  gaussians.scales = scales;
  gaussians.rotations = rotations;
  gaussians.opacities = opacities;
  gaussians.colors = colors;
  Rasterizer rasterizer(threads);
  std::vector<float> image(3 * static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
  RasterImages images;
  images.color = image;
  rasterizer.forward(camera, gaussians, RasterOptions{}, images);
  std::vector<std::uint8_t> color;
  for (const float value : image) {
    color.push_back(static_cast<std::uint8_t>(std::lround(255 * std::fmin(std::fmax(value, 0.0f), 1.0f))));
  }
  return color;
}

/// One camera per moment, as in a monocular video; every eighth is held out.
inline Scene moving_scene(const Threads& threads, int views = 24, int width = 40, int height = 32) {
  Scene scene;
  for (int v = 0; v < views; ++v) {
    // Neighbouring times get distant angles, so that time and pose are not correlated.
    const double angle = 6.283185307179586 * (v * 7 % views) / views;
    View view;
    view.name = "frame_" + std::to_string(v) + ".png";
    view.camera = camera_looking_at_origin({4 * std::cos(angle), -0.8, 4 * std::sin(angle)}, width, height);
    view.time = static_cast<float>(v) / static_cast<float>(views - 1);
    view.color = moving_truth(view.camera, view.time, threads);
    (v % 8 == 4 ? scene.test : scene.train).push_back(std::move(view));
  }
  const RandomStream random(12, 0, RandomPurpose::synth);
  for (std::uint64_t i = 0; i < 3 * 150; ++i) {
    scene.points.positions.push_back(static_cast<float>(2.4 * random.uniform(i) - 1.2));
    scene.points.colors.push_back(128);
  }
  scene.extent = camera_extent(scene.train);
  return scene;
}

}  // namespace splatboost::testing

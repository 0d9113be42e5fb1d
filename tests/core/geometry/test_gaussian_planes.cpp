// SPDX-License-Identifier: Apache-2.0
// Planes of Gaussians: known cases, and gradients against finite differences in double.
#include "splatboost/gaussian_planes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <glm/gtc/quaternion.hpp>

#include "splatboost/random.h"
#include "support/looking_camera.h"
#include "support/scenes.h"

namespace splatboost {
namespace {

TEST(GaussianPlanes, are_normal_to_the_shortest_axis_and_face_the_camera) {
  // At (0, 0, −5), looking along +z: flat along z, and along x.
  Camera camera;
  camera.width = camera.height = 10;
  camera.fx = camera.fy = 10;
  camera.camera_from_world[3] = glm::vec4(0, 0, 5, 1);
  const std::vector<float> means{0, 0, 1, 2, 0, 1}, scales{1, 1, 0.1f, 0.1f, 1, 1}, rotations{2, 0, 0, 0, 1, 0, 0, 0};
  Gaussians gaussians;
  gaussians.count = 2;
  gaussians.means = means;
  gaussians.scales = scales;
  gaussians.rotations = rotations;
  std::vector<float> planes(8);
  Threads threads(1);
  gaussian_planes(gaussians, camera, planes, threads);
  EXPECT_EQ(planes, (std::vector<float>{0, 0, -1, 6, -1, 0, 0, 2}));
}

/// The plane of a Gaussian (normal in the camera frame, distance), in double.
/// @param in [7] mean, quaternion
std::array<double, 4> plane_of(const std::array<double, 7>& in, const std::array<double, 3>& scales,
                               const Camera& camera) {
  const double length = std::hypot(std::hypot(in[3], in[4]), std::hypot(in[5], in[6]));
  const double w = in[3] / length, x = in[4] / length, y = in[5] / length, z = in[6] / length;
  const glm::dmat3 axes = glm::mat3_cast(glm::dquat(w, x, y, z));
  const auto shortest = std::ranges::min_element(scales) - scales.begin();
  const glm::dmat4 camera_from_world(camera.camera_from_world);
  glm::dvec3 normal = glm::dmat3(camera_from_world) * axes[static_cast<int>(shortest)];
  const glm::dvec3 mean(camera_from_world * glm::dvec4(in[0], in[1], in[2], 1));
  if (glm::dot(normal, mean) > 0) normal = -normal;
  return {normal.x, normal.y, normal.z, -glm::dot(normal, mean)};
}

constexpr std::size_t kCount = 101;  // several vectors, and a part of one

/// Gaussians of which every axis is the shortest of some; all numbers exact as floats.
test::SceneData random_gaussians() {
  test::SceneData scene;
  scene.count = kCount;
  const RandomStream random(3, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  for (std::size_t i = 0; i < 3 * kCount; ++i) scene.means.push_back(static_cast<float>(random.normal(next++)));
  for (std::size_t i = 0; i < 4 * kCount; ++i) scene.rotations.push_back(static_cast<float>(random.normal(next++)));
  for (std::size_t i = 0; i < 3 * kCount; ++i) scene.scales.push_back(static_cast<float>(0.1 + random.uniform(next++)));
  return scene;
}

/// Mean and quaternion of Gaussian i.
std::array<double, 7> row(const test::SceneData& scene, std::size_t i) {
  const float *mean = &scene.means[3 * i], *rotation = &scene.rotations[4 * i];
  return {mean[0], mean[1], mean[2], rotation[0], rotation[1], rotation[2], rotation[3]};
}

std::array<double, 3> scales_of(const test::SceneData& scene, std::size_t i) {
  return {scene.scales[3 * i], scene.scales[3 * i + 1], scene.scales[3 * i + 2]};
}

TEST(GaussianPlanes, are_those_in_double) {
  const test::SceneData random = random_gaussians();
  const Camera camera = testing::camera_looking_at_origin({3, -1, 2}, 40, 30);
  std::array<int, 3> shortest{};
  for (const int threads_used : {1, 2}) {
    Threads threads(threads_used);
    std::vector<float> planes(4 * kCount);
    gaussian_planes(random.view(), camera, planes, threads);
    for (std::size_t i = 0; i < kCount; ++i) {
      const std::array<double, 3> scales = scales_of(random, i);
      ++shortest[static_cast<std::size_t>(std::ranges::min_element(scales) - scales.begin())];
      const std::array<double, 4> expected = plane_of(row(random, i), scales, camera);
      for (std::size_t c = 0; c < 4; ++c) EXPECT_NEAR(planes[4 * i + c], expected[c], 3e-6) << i << " " << c;
    }
  }
  for (const int count : shortest) EXPECT_GT(count, 0) << "each axis must be the shortest once";
}

TEST(GaussianPlanes, gradients_are_those_of_finite_differences_in_double_and_accumulate) {
  const test::SceneData random = random_gaussians();
  const Camera camera = testing::camera_looking_at_origin({3, -1, 2}, 40, 30);
  const RandomStream numbers(4, 0, RandomPurpose::synth);
  std::vector<float> weights(4 * kCount);
  for (std::size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<float>(numbers.normal(i));
  std::vector<float> means(3 * kCount, 1), rotations(4 * kCount, 2);
  Threads threads(2);
  gaussian_planes_backward(random.view(), camera, weights, means, rotations, threads);
  for (std::size_t i = 0; i < kCount; ++i) {
    const auto objective = [&](const std::array<double, 7>& at) {
      const std::array<double, 4> plane = plane_of(at, scales_of(random, i), camera);
      double sum = 0;
      for (std::size_t c = 0; c < 4; ++c) sum += static_cast<double>(weights[4 * i + c]) * plane[c];
      return sum;
    };
    for (std::size_t k = 0; k < 7; ++k) {
      std::array<double, 7> up = row(random, i), down = up;
      up[k] += 1e-6;
      down[k] -= 1e-6;
      const double expected = (objective(up) - objective(down)) / 2e-6;
      const double gradient = k < 3 ? means[3 * i + k] - 1 : rotations[4 * i + k - 3] - 2;
      EXPECT_NEAR(gradient, expected, 3e-6 * (1 + std::abs(expected))) << "Gaussian " << i << " input " << k;
    }
  }
}

TEST(GaussianPlanes, without_a_gradient_nothing_is_added_even_if_the_quaternion_is_zero) {
  test::SceneData random = random_gaussians();
  std::fill_n(random.rotations.begin() + 4 * 7, 4, 0.0f);
  std::vector<float> weights(4 * kCount, 0.0f);
  weights[4 * 5] = 1;
  std::vector<float> means(3 * kCount, 1), rotations(4 * kCount, 2);
  Threads threads(1);
  gaussian_planes_backward(random.view(), testing::camera_looking_at_origin({3, -1, 2}, 40, 30), weights, means,
                           rotations, threads);
  for (std::size_t i = 0; i < kCount; ++i) {
    if (i == 5) continue;
    for (std::size_t c = 0; c < 3; ++c) EXPECT_EQ(means[3 * i + c], 1) << i;
    for (std::size_t c = 0; c < 4; ++c) EXPECT_EQ(rotations[4 * i + c], 2) << i;
  }
  EXPECT_NE(rotations[4 * 5], 2);
}

TEST(Flatness, is_the_mean_smallest_scale_of_those_seen) {
  const std::vector<float> scales{0.5f, 0.2f, 0.9f, 9, 9, 1, 0.4f, 0.7f, 0.4f};
  const std::vector<std::uint8_t> visible{1, 0, 1};
  std::vector<float> gradients(9, 1);
  std::vector<double> sums(2);
  Threads threads(2);
  flatness_loss(scales, visible, 100, sums, threads);
  flatness_loss_backward(scales, visible, 100, sums, gradients, threads);
  EXPECT_EQ(gradients, (std::vector<float>{1, 51, 1, 1, 1, 1, 51, 1, 1}));
  EXPECT_NEAR(sums[0], 100 * (0.2 + 0.4) / 2, 1e-5);
  flatness_loss(scales, std::vector<std::uint8_t>(3, 0), 100, sums, threads);
  EXPECT_EQ(sums[0], 0) << "of none that is seen";
}

}  // namespace
}  // namespace splatboost

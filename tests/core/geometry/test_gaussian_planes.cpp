// SPDX-License-Identifier: Apache-2.0
// Planes of Gaussians: known cases, and gradients against finite differences in double.
#include "splatboost/gaussian_planes.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "geometry/surface_math.h"
#include "splatboost/random.h"
#include "support/looking_camera.h"

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

TEST(GaussianPlanes, gradient_is_that_of_finite_differences) {
  const RandomStream random(3, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  const Camera camera = testing::camera_looking_at_origin({3, -1, 2}, 40, 30);
  const auto motion = surface::camera_from_world_of<double>(camera);
  std::array<bool, 3> axes{};
  for (int trial = 0; trial < 100; ++trial) {
    std::array<double, 7> in{};  // mean, rotation
    for (double& value : in) value = random.normal(next++);
    std::array<double, 3> scales{};
    for (double& scale : scales) scale = 0.1 + random.uniform(next++);
    std::array<double, 4> weights{};
    for (double& weight : weights) weight = random.normal(next++);
    const auto objective = [&](const std::array<double, 7>& at) {
      const auto plane = surface::PlaneOf<double>(at.data(), scales.data(), at.data() + 3, motion).plane(motion);
      return weights[0] * plane.normal.x + weights[1] * plane.normal.y + weights[2] * plane.normal.z +
             weights[3] * plane.distance;
    };
    const surface::PlaneOf<double> of(in.data(), scales.data(), in.data() + 3, motion);
    axes[static_cast<std::size_t>(of.axis)] = true;
    std::array<double, 7> gradient{1, 2, 3, 4, 5, 6, 7};  // gradients accumulate
    of.backward(motion, {{weights[0], weights[1], weights[2]}, weights[3]}, gradient.data(), gradient.data() + 3);
    for (std::size_t k = 0; k < 7; ++k) {
      std::array<double, 7> up = in, down = in;
      up[k] += 1e-6;
      down[k] -= 1e-6;
      const double expected = (objective(up) - objective(down)) / 2e-6;
      EXPECT_NEAR(gradient[k] - static_cast<double>(k + 1), expected, 1e-6 * (1 + std::abs(expected)))
          << "trial " << trial << " input " << k;
    }
  }
  EXPECT_TRUE(axes[0] && axes[1] && axes[2]) << "each axis must be the shortest once";
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

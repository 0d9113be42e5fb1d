// SPDX-License-Identifier: Apache-2.0
// The 3D smoothing filter: its size for given cameras, its effect on a Gaussian, and the gradient of that.
#include "splatboost/smoothing.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "splatboost/random.h"

namespace splatboost {
namespace {

/// A camera at (0, 0, z) looking along +z, with 100×100 pixels and the given focal length.
Camera view_from(float z, float focal) {
  Camera camera;
  camera.width = camera.height = 100;
  camera.fx = camera.fy = focal;
  camera.cx = camera.cy = 50;
  camera.camera_from_world[3] = glm::vec4(0, 0, -z, 1);
  return camera;
}

std::vector<float> filters_of(const std::vector<float>& means, const std::vector<Camera>& views) {
  Threads threads(2);
  std::vector<float> filters(means.size() / 3);
  SmoothingFilters(views, 0.2, 0.15, threads).compute(means, filters);
  return filters;
}

TEST(SmoothingFilter, is_that_of_the_view_which_resolves_the_mean_best) {
  const float root = std::sqrt(0.2f);
  // Depth 4 at focal length 100, depth 2 at 80: sampled at 25 and 40 pixels per unit.
  EXPECT_FLOAT_EQ(filters_of({0, 0, 4}, {view_from(0, 100)})[0], root * 4 / 100);
  EXPECT_FLOAT_EQ(filters_of({0, 0, 4}, {view_from(0, 100), view_from(2, 80)})[0], root * 2 / 80);
  EXPECT_FLOAT_EQ(filters_of({0, 0, 4}, {view_from(0, 100), view_from(2, 40)})[0], root * 4 / 100)
      << "nearer, but with wider pixels";
}

TEST(SmoothingFilter, counts_views_up_to_a_margin_beyond_their_border) {
  // At depth 2 and focal length 100 a pixel is 0.02 wide: the border lies at x = 1, the margin's end at 1.3.
  const std::vector<Camera> views = {view_from(0, 100), view_from(-8, 100)};
  const float root = std::sqrt(0.2f);
  const std::vector<float> filters = filters_of({1.29f, 0, 2, 1.31f, 0, 2, 0, -1.29f, 2, 0, -1.31f, 2}, views);
  EXPECT_FLOAT_EQ(filters[0], root * 2 / 100);
  EXPECT_FLOAT_EQ(filters[1], root * 10 / 100) << "only the far view sees it";
  EXPECT_FLOAT_EQ(filters[2], root * 2 / 100);
  EXPECT_FLOAT_EQ(filters[3], root * 10 / 100);
}

TEST(SmoothingFilter, unseen_means_get_the_largest_of_the_seen) {
  const std::vector<float> filters =
      filters_of({0, 0, 4, 0, 0, 7, 0, 0, -3, 0, 0, 0.1f, 90, 0, 4}, {view_from(0, 100)});
  for (const std::size_t unseen : {2u, 3u, 4u}) EXPECT_EQ(filters[unseen], filters[1]);
  EXPECT_EQ(filters_of({0, 0, -1}, {view_from(0, 100)}), std::vector<float>{0}) << "none is seen: none is filtered";
  EXPECT_TRUE(filters_of({}, {view_from(0, 100)}).empty());
}

TEST(SmoothedGaussian, keeps_its_integral) {
  const std::array<double, 3> scales{0.3, 0.04, 2};
  const SmoothedGaussian<double> out = smooth(scales.data(), 0.7, 0.05);
  double before = 0.7, after = out.opacity;
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(out.scales[c] * out.scales[c], scales[c] * scales[c] + 0.05 * 0.05, 1e-12);
    before *= scales[c];
    after *= out.scales[c];
  }
  EXPECT_NEAR(after, before, 1e-12);
  EXPECT_NEAR(out.opacity, 0.7 * out.factor, 1e-15);
}

TEST(SmoothedGaussian, without_a_filter_it_is_unchanged) {
  const std::array<float, 3> scales{0.25f, 0.5f, 2};
  const SmoothedGaussian<float> out = smooth(scales.data(), 0.7f, 0.0f);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_EQ(out.scales[c], scales[c]);
  EXPECT_EQ(out.opacity, 0.7f);
}

TEST(SmoothedGaussian, gradient_is_that_of_finite_differences) {
  const RandomStream random(3, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  for (int trial = 0; trial < 200; ++trial) {
    // Scales from far below to far above the filter.
    std::array<double, 4> in{};
    for (std::size_t c = 0; c < 3; ++c) in[c] = std::exp(4 * random.uniform(next++) - 5);
    in[3] = random.uniform(next++);
    const double filter = 0.05;
    std::array<double, 4> weights{};
    for (double& weight : weights) weight = random.normal(next++);
    const auto objective = [&](const std::array<double, 4>& at) {
      const SmoothedGaussian<double> out = smooth(at.data(), at[3], filter);
      return weights[0] * out.scales[0] + weights[1] * out.scales[1] + weights[2] * out.scales[2] +
             weights[3] * out.opacity;
    };
    std::array<double, 4> gradient{1, 2, 3, 4};  // gradients accumulate
    smooth_backward(in.data(), filter, smooth(in.data(), in[3], filter), weights.data(), weights[3], gradient.data(),
                    gradient[3]);
    for (std::size_t k = 0; k < 4; ++k) {
      const double step = 1e-6 * in[k];
      std::array<double, 4> up = in, down = in;
      up[k] += step;
      down[k] -= step;
      const double expected = (objective(up) - objective(down)) / (2 * step);
      EXPECT_NEAR(gradient[k] - static_cast<double>(k + 1), expected, 1e-7 * (1 + std::abs(expected)))
          << "trial " << trial << " input " << k;
    }
  }
}

TEST(SmoothedGaussian, of_vanishing_scales_stays_finite) {
  for (const float scale : {0.0f, std::numeric_limits<float>::denorm_min(), 1e-30f, 1e-12f}) {
    const std::array<float, 3> scales{scale, scale, scale};
    const SmoothedGaussian<float> out = smooth(scales.data(), 0.9f, 1e-3f);
    const std::array<float, 3> up{1, 1, 1};
    std::array<float, 4> gradient{};
    smooth_backward(scales.data(), 1e-3f, out, up.data(), 1.0f, gradient.data(), gradient[3]);
    EXPECT_TRUE(std::isfinite(out.opacity));
    for (const float g : gradient) EXPECT_TRUE(std::isfinite(g)) << scale;
  }
}

}  // namespace
}  // namespace splatboost

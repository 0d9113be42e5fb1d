// SPDX-License-Identifier: Apache-2.0
// The deformation field: rigid motions against matrix exponentials, gradients against finite differences in double.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "deformable_3dgs/deformation_math.h"
#include "deformable_3dgs/deformation_on_cpu.h"

namespace splatboost {
namespace {

using Matrix4 = std::array<std::array<double, 4>, 4>;

Matrix4 product(const Matrix4& a, const Matrix4& b) {
  Matrix4 c{};
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t j = 0; j < 4; ++j) {
      for (std::size_t k = 0; k < 4; ++k) c[i][j] += a[i][k] * b[k][j];
    }
  }
  return c;
}

/// A point moved by the exponential of the twist's 4×4 matrix, computed by its power series.
std::array<double, 3> moved_by_series(const std::array<double, 6>& m, const std::array<double, 3>& x) {
  const Matrix4 twist{{{0, -m[2], m[1], m[3]}, {m[2], 0, -m[0], m[4]}, {-m[1], m[0], 0, m[5]}, {0, 0, 0, 0}}};
  Matrix4 sum{}, term{};
  for (std::size_t i = 0; i < 4; ++i) sum[i][i] = term[i][i] = 1;
  for (int n = 1; n < 60; ++n) {
    term = product(term, twist);
    for (auto& row : term) {
      for (double& value : row) value /= n;
    }
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = 0; j < 4; ++j) sum[i][j] += term[i][j];
    }
  }
  std::array<double, 3> moved{};
  for (std::size_t i = 0; i < 3; ++i) moved[i] = sum[i][0] * x[0] + sum[i][1] * x[1] + sum[i][2] * x[2] + sum[i][3];
  return moved;
}

TEST(RigidMotion, is_the_exponential_of_its_twist) {
  const std::array<double, 3> x{0.3, -1.2, 2.0};
  // Small angles, angles around the switch between series and closed form, and more than a full turn.
  for (const double size : {0.0, 1e-9, 1e-3, 0.99999, 1.00001, 2.0, 7.0}) {
    const std::array<double, 6> motion{0.6 * size, -0.48 * size, 0.64 * size, 0.7, -0.2, 0.4};
    double moved[3];
    move_rigidly(x.data(), motion.data(), moved);
    const std::array<double, 3> expected = moved_by_series(motion, x);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(moved[c], expected[c], 1e-11) << size;
    const float x32[3] = {0.3f, -1.2f, 2.0f};
    float motion32[6], moved32[3];
    for (std::size_t c = 0; c < 6; ++c) motion32[c] = static_cast<float>(motion[c]);
    move_rigidly(x32, motion32, moved32);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(moved32[c], static_cast<float>(expected[c]), 3e-6f) << size;
  }
}

TEST(RigidMotion, gradients_are_those_of_finite_differences_also_of_no_motion) {
  const double g[3] = {0.9, -0.4, 0.7};
  for (const double size : {0.0, 1e-4, 0.9999, 1.5, 4.0}) {
    std::array<double, 3> x{0.3, -1.2, 2.0};
    std::array<double, 6> motion{0.6 * size, -0.48 * size, 0.64 * size, 0.7, -0.2, 0.4};
    double of_x[3] = {1, 1, 1}, of_motion[6];
    move_rigidly_backward(x.data(), motion.data(), g, of_x, of_motion);
    const auto slope = [&](double& value) {
      constexpr double kStep = 1e-5;
      const auto loss = [&](double at) {
        value = at;
        double moved[3];
        move_rigidly(x.data(), motion.data(), moved);
        return g[0] * moved[0] + g[1] * moved[1] + g[2] * moved[2];
      };
      const double was = value, above = loss(was + kStep), below = loss(was - kStep);
      value = was;
      return (above - below) / (2 * kStep);
    };
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(of_x[c] - 1, slope(x[c]), 1e-8) << size;
    for (std::size_t c = 0; c < 6; ++c) EXPECT_NEAR(of_motion[c], slope(motion[c]), 1e-8) << size << " " << c;
  }
}

/// A small field with its Gaussians, and a loss: a weighted sum of the deformed parameters.
struct Bench {
  static constexpr std::size_t kCount = 5;

  Bench(const DeformationShape& of, const Threads& threads) : shape(of), field(of, threads) {
    const RandomStream random(4, 0, RandomPurpose::net_parameters);
    std::uint64_t next = 0;
    const auto fill = [&](std::vector<double>& values, std::size_t n, double scale) {
      values.resize(n);
      for (double& value : values) value = scale * random.normal(next++);
    };
    fill(p, shape.parameters(), 0.4);
    fill(means, 3 * kCount, 1);
    fill(scales, 3 * kCount, 1);
    fill(rotations, 4 * kCount, 1);
    fill(weights, 10 * kCount, 1);
  }
  double loss() {
    std::vector<double> moved(10 * kCount);
    field.forward(p, {means, scales, rotations}, 0.37, places(moved), true);
    double sum = 0;
    for (std::size_t i = 0; i < moved.size(); ++i) sum += weights[i] * moved[i];
    return sum;
  }
  static GaussianPlaces<double> places(std::vector<double>& of) {
    const std::span<double> all(of);
    return {all.first(3 * kCount), all.subspan(3 * kCount, 3 * kCount), all.last(4 * kCount)};
  }
  static GaussianPlaces<const double> places_of(const std::vector<double>& of) {
    const std::span<const double> all(of);
    return {all.first(3 * kCount), all.subspan(3 * kCount, 3 * kCount), all.last(4 * kCount)};
  }
  double slope(double& value) {
    constexpr double kStep = 1e-6;
    const double was = value;
    value = was + kStep;
    const double above = loss();
    value = was - kStep;
    const double below = loss();
    value = was;
    return (above - below) / (2 * kStep);
  }

  DeformationShape shape;
  DeformationOnCpu<double> field;
  std::vector<double> p, means, scales, rotations, weights;
};

TEST(DeformationField, gradients_are_those_of_finite_differences) {
  Threads threads(2);
  for (const bool rigid : {false, true}) {
    for (const bool time_net : {false, true}) {
      DeformationShape shape;
      shape.position_frequencies = 2;
      shape.time_frequencies = 2;
      shape.rigid = rigid;
      shape.time_net = time_net;
      shape.layers = 3;
      shape.width = 6;
      Bench bench(shape, threads);
      bench.loss();
      std::vector<double> of_gaussians(10 * Bench::kCount, 0.5), of_p(bench.p.size(), 0.25);  // gradients accumulate
      bench.field.backward(bench.p, {bench.means, bench.scales, bench.rotations}, Bench::places_of(bench.weights),
                           Bench::places(of_gaussians), of_p);
      // Only every 37th parameter of the time net, which has thousands.
      const std::size_t of_net = shape.net().parameters();
      for (std::size_t i = 0; i < of_p.size(); i += i < of_net ? 1 : 37) {
        const double expected = bench.slope(bench.p[i]);
        ASSERT_NEAR(of_p[i] - 0.25, expected, 1e-7 * (1 + std::abs(expected))) << i;
      }
      const auto of = Bench::places(of_gaussians);
      for (std::size_t i = 0; i < of.scales.size(); ++i) {
        ASSERT_NEAR(of.scales[i] - 0.5, bench.slope(bench.scales[i]), 1e-8);
      }
      for (std::size_t i = 0; i < of.rotations.size(); ++i) {
        ASSERT_NEAR(of.rotations[i] - 0.5, bench.slope(bench.rotations[i]), 1e-7);
      }
    }
  }
}

TEST(DeformationField, no_gradient_of_a_mean_goes_through_the_net) {
  Threads threads(1);
  DeformationShape shape;
  shape.layers = 3;
  shape.width = 6;
  Bench bench(shape, threads);
  bench.loss();
  std::vector<double> of_gaussians(10 * Bench::kCount), of_p(bench.p.size());
  bench.field.backward(bench.p, {bench.means, bench.scales, bench.rotations}, Bench::places_of(bench.weights),
                       Bench::places(of_gaussians), of_p);
  double through_net = 0;
  for (std::size_t i = 0; i < 3 * Bench::kCount; ++i) {
    EXPECT_EQ(of_gaussians[i], bench.weights[i]) << "as if the shift did not depend on it";
    through_net += std::abs(bench.slope(bench.means[i]) - bench.weights[i]);
  }
  EXPECT_GT(through_net, 0.1) << "but it does";
}

TEST(DeformationField, sizes_are_the_published_ones) {
  DeformationShape real;
  EXPECT_EQ(real.parameters(), 506378u);
  DeformationShape blender;
  blender.time_frequencies = 6;
  blender.time_net = true;
  EXPECT_EQ(blender.parameters(), 522280u);
  const std::vector<float> start = initial_deformation(blender, RandomStream(1, 0, RandomPurpose::net_parameters));
  EXPECT_EQ(start.size(), blender.parameters());
}

}  // namespace
}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
// The two-layer net: values against plain loops, gradients against finite differences in double.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "families/nets/smooth_functions.h"
#include "families/nets/two_layer_net.h"

namespace splatboost {
namespace {

constexpr NetShape kShape{7, 5, 4};
constexpr std::size_t kRows = 9;

std::vector<double> random_values(std::size_t n, std::uint64_t seed) {
  const RandomStream random(seed, 0, RandomPurpose::net_parameters);
  std::vector<double> values(n);
  for (std::size_t i = 0; i < n; ++i) values[i] = random.normal(i);
  return values;
}

std::vector<double> plain_forward(const std::vector<double>& p, const std::vector<double>& x) {
  std::vector<double> y;
  const double* w1 = p.data();
  const double* b1 = w1 + kShape.hidden * kShape.inputs;
  const double* w2 = b1 + kShape.hidden;
  const double* b2 = w2 + kShape.outputs * kShape.hidden;
  for (std::size_t r = 0; r < x.size() / kShape.inputs; ++r) {
    std::vector<double> h(kShape.hidden);
    for (std::size_t i = 0; i < kShape.hidden; ++i) {
      double sum = b1[i];
      for (std::size_t c = 0; c < kShape.inputs; ++c) sum += w1[i * kShape.inputs + c] * x[r * kShape.inputs + c];
      h[i] = std::max(sum, 0.0);
    }
    for (std::size_t o = 0; o < kShape.outputs; ++o) {
      double sum = b2[o];
      for (std::size_t i = 0; i < kShape.hidden; ++i) sum += w2[o * kShape.hidden + i] * h[i];
      y.push_back(sum);
    }
  }
  return y;
}

TEST(TwoLayerNet, values_are_those_of_the_definition) {
  const std::vector<double> p = random_values(kShape.parameters(), 1), x = random_values(kRows * kShape.inputs, 2);
  std::vector<double> h(kRows * kShape.hidden), y(kRows * kShape.outputs);
  net_forward<double>(kShape, p, kRows, x.data(), h.data(), y.data());
  const std::vector<double> expected = plain_forward(p, x);
  for (std::size_t i = 0; i < y.size(); ++i) EXPECT_NEAR(y[i], expected[i], 1e-12);
}

TEST(TwoLayerNet, gradients_are_those_of_finite_differences) {
  std::vector<double> p = random_values(kShape.parameters(), 3), x = random_values(kRows * kShape.inputs, 4);
  const std::vector<double> weights = random_values(kRows * kShape.outputs, 5);  // loss = Σ weights·y
  const auto loss = [&] {
    const std::vector<double> y = plain_forward(p, x);
    double sum = 0;
    for (std::size_t i = 0; i < y.size(); ++i) sum += weights[i] * y[i];
    return sum;
  };
  std::vector<double> h(kRows * kShape.hidden), y(kRows * kShape.outputs), scratch(h.size());
  net_forward<double>(kShape, p, kRows, x.data(), h.data(), y.data());
  std::vector<double> dp(p.size(), 1.0), dx(x.size(), 9.0);  // dp accumulates, dx is overwritten
  net_backward<double>(kShape, p, kRows, x.data(), h.data(), weights.data(), scratch.data(), dp, dx.data());
  constexpr double kStep = 1e-6;
  const auto slope = [&](double& value) {
    const double was = value;
    value = was + kStep;
    const double above = loss();
    value = was - kStep;
    const double below = loss();
    value = was;
    return (above - below) / (2 * kStep);
  };
  for (std::size_t i = 0; i < p.size(); ++i) EXPECT_NEAR(dp[i] - 1.0, slope(p[i]), 1e-7) << "parameter " << i;
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_NEAR(dx[i], slope(x[i]), 1e-7) << "input " << i;
}

TEST(TwoLayerNet, parameters_start_within_the_layers_bounds) {
  const RandomStream random(0, 0, RandomPurpose::net_parameters);
  const std::vector<float> p = initial_net_parameters({36, 16, 8}, random, 0);
  ASSERT_EQ(p.size(), 16u * 37 + 8 * 17);
  const auto largest = [&](std::size_t begin, std::size_t end) {
    float most = 0;
    for (std::size_t i = begin; i < end; ++i) most = std::max(most, std::abs(p[i]));
    return most;
  };
  EXPECT_LE(largest(0, 16 * 37), 1.0f / 6);
  EXPECT_GT(largest(0, 16 * 37), 0.95f / 6);
  EXPECT_LE(largest(16 * 37, p.size()), 0.25f);
  EXPECT_GT(largest(16 * 37, p.size()), 0.22f);
}

TEST(SmoothFunctions, stay_close_to_the_library_and_within_range) {
  for (float x = -86.0f; x < 87.0f; x += 0.037f) {
    const double expected = std::exp(static_cast<double>(x));
    EXPECT_NEAR(smooth_exp(x) / expected, 1.0, 4e-7) << x;
    EXPECT_NEAR(sigmoid(x), 1 / (1 + std::exp(-static_cast<double>(x))), 2e-7) << x;
    EXPECT_NEAR(smooth_tanh(x), std::tanh(static_cast<double>(x)), 3e-7) << x;
  }
  for (const float x : {-1e30f, -200.0f, 200.0f, 1e30f}) {
    EXPECT_TRUE(std::isfinite(smooth_exp(x)));
    EXPECT_TRUE(sigmoid(x) >= 0 && sigmoid(x) <= 1);
    EXPECT_TRUE(std::abs(smooth_tanh(x)) <= 1);
  }
  EXPECT_EQ(smooth_exp(0.0f), 1.0f);
}

}  // namespace
}  // namespace splatboost

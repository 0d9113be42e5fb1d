// SPDX-License-Identifier: Apache-2.0
#include "splatboost/activations.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "splatboost/errors.h"
#include "support/instruction_sets.h"

namespace splatboost::test {
namespace {

TEST(Activations, AgreeWithTheLibrarysInDouble) {
  Threads threads(2);
  std::vector<float> from;
  for (float x = -30; x < 30; x += 0.003f) from.push_back(x);
  std::vector<float> to(from.size());
  for_each_target([&] {
    exponentials(from, to, threads);
    for (std::size_t i = 0; i < from.size(); ++i) {
      const double expected = std::exp(static_cast<double>(from[i]));
      ASSERT_NEAR(static_cast<double>(to[i]), expected, 3e-7 * expected) << from[i];
    }
    sigmoids(from, to, threads);
    for (std::size_t i = 0; i < from.size(); ++i) {
      const double expected = 1 / (1 + std::exp(-static_cast<double>(from[i])));
      ASSERT_NEAR(static_cast<double>(to[i]), expected, 1e-6 * expected) << from[i];
    }
  });
}

TEST(Activations, NeitherOverflowNorTurnNegativeAtExtremes) {
  Threads threads(1);
  const float infinity = std::numeric_limits<float>::infinity();
  const double most = std::exp(88.0);  // a finite float
  std::vector<float> from = {87.9f, 88, 88.1f, 100, 1e30f, infinity, -100, -1000, -1e30f, -infinity}, to(from.size());
  for_each_target([&] {
    exponentials(from, to, threads);
    for (std::size_t i = 0; i < from.size(); ++i) {
      const double expected = std::min(std::exp(static_cast<double>(from[i])), most);
      // Values that have no normal float may become 0.
      EXPECT_NEAR(static_cast<double>(to[i]), expected, 3e-7 * expected + 1.2e-38) << from[i];
      EXPECT_GE(to[i], 0) << from[i];
    }
    sigmoids(from, to, threads);
    for (std::size_t i = 0; i < from.size(); ++i) {
      EXPECT_NEAR(to[i], from[i] > 0 ? 1 : 0, 1.2e-38) << from[i];
      EXPECT_GE(to[i], 0) << from[i];
    }
  });
}

// The derivatives are central differences in double, of the functions by their definitions.
TEST(Activations, GradientsAreThoseOfFiniteDifferences) {
  Threads threads(2);
  const auto exponential = [](double x) { return std::exp(x); };
  const auto sigmoid = [](double x) { return 1 / (1 + std::exp(-x)); };
  const auto slope = [](const auto& function, double x) { return (function(x + 1e-5) - function(x - 1e-5)) / 2e-5; };
  for (const std::size_t n : {std::size_t{67}, std::size_t{20011}}) {  // no whole number of vectors; several threads
    std::vector<double> inputs;
    std::vector<float> exponentials, sigmoids, upstream;
    for (std::size_t i = 0; i < n; ++i) {
      // Nearer to 0 and 1, sigmoids in float would have lost the digits that the test expects.
      inputs.push_back(8 * static_cast<double>(i * 29 % n) / static_cast<double>(n) - 4);
      exponentials.push_back(static_cast<float>(exponential(inputs[i])));
      sigmoids.push_back(static_cast<float>(sigmoid(inputs[i])));
      upstream.push_back(static_cast<float>(i % 11) - 5);  // also negative and 0
    }
    for_each_target([&] {
      std::vector<float> of_exponentials = upstream, of_sigmoids = upstream;
      exponential_gradients(exponentials, of_exponentials, threads);
      sigmoid_gradients(sigmoids, of_sigmoids, threads);
      for (std::size_t i = 0; i < n; ++i) {
        const double by_exponential = static_cast<double>(upstream[i]) * slope(exponential, inputs[i]);
        ASSERT_NEAR(of_exponentials[i], by_exponential, 1e-6 * std::abs(by_exponential)) << i << " of " << n;
        const double by_sigmoid = static_cast<double>(upstream[i]) * slope(sigmoid, inputs[i]);
        ASSERT_NEAR(of_sigmoids[i], by_sigmoid, 1e-5 * std::abs(by_sigmoid)) << i << " of " << n;
      }
    });
  }
  std::vector<float> three(3), two(2);
  EXPECT_THROW(exponential_gradients(three, two, threads), ArgumentError);
  EXPECT_THROW(sigmoid_gradients(three, two, threads), ArgumentError);
}

TEST(Activations, TakeAnySizeAndExtremes) {
  Threads threads(1);
  for (std::size_t n = 0; n < 40; ++n) {
    std::vector<float> from(n, 1.0f), to(n + 1, 7.0f);
    exponentials(from, std::span(to).first(n), threads);
    for (std::size_t i = 0; i < n; ++i) EXPECT_NEAR(to[i], 2.7182817f, 1e-6f);
    EXPECT_EQ(to[n], 7.0f);
  }
  const float huge = 1000;
  std::vector<float> from = {-huge, huge, 0}, to(3);
  sigmoids(from, to, threads);
  EXPECT_NEAR(to[0], 0, 1e-37);
  EXPECT_EQ(to[1], 1.0f);
  EXPECT_EQ(to[2], 0.5f);
  EXPECT_THROW(sigmoids(from, std::span(to).first(2), threads), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test

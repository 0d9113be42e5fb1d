// SPDX-License-Identifier: Apache-2.0
#include "splatboost/activations.h"

#include <gtest/gtest.h>

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

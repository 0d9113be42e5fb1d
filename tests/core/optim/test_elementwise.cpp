// SPDX-License-Identifier: Apache-2.0
#include "splatboost/elementwise.h"

#include <gtest/gtest.h>

#include <vector>

#include "splatboost/threads.h"

namespace splatboost::test {
namespace {

TEST(Elementwise, ClampsAboveABound) {
  Threads threads(2);
  std::vector<float> values = {-2, 0.5f, 1, 1.5f, 7};
  clamp_above(values, 1, threads);
  EXPECT_EQ(values, (std::vector<float>{-2, 0.5f, 1, 1, 1}));
}

TEST(Elementwise, NoGradientPassesWhereTheClampActs) {
  Threads threads(2);
  const std::vector<float> clamped = {-2, 0.5f, 1, 1};
  std::vector<float> gradients = {3, 4, 5, -6};
  clear_from(clamped, 1, gradients, threads);
  EXPECT_EQ(gradients, (std::vector<float>{3, 4, 0, 0}));
}

TEST(Elementwise, AveragesMoveByAShareOfTheWay) {
  Threads threads(2);
  const std::vector<float> values = {4, -2, 1};
  std::vector<float> averages = {0, 2, 1};
  average_in(values, 0.25f, averages, threads);
  EXPECT_EQ(averages, (std::vector<float>{1, 1, 1}));
}

}  // namespace
}  // namespace splatboost::test

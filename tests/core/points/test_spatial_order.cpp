// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "splatboost/errors.h"
#include "splatboost/random.h"
#include "splatboost/spatial_order.h"

namespace splatboost::test {
namespace {

TEST(SpatialOrder, VisitsOctantsOneAfterTheOther) {
  // Corners of a cube, not in spatial order.
  const std::vector<float> means = {1, 1, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 1, 1, 0, 0, 1, 1, 1, 0, 1};
  std::vector<std::uint32_t> order(8);
  spatial_order(means, order);
  EXPECT_EQ(order, (std::vector<std::uint32_t>{1, 3, 2, 5, 4, 7, 6, 0}));  // x varies fastest
}

TEST(SpatialOrder, IsAPermutationThatBringsNeighboursTogether) {
  constexpr std::size_t kPoints = 4000;
  const RandomStream random(3, 0, RandomPurpose::view_order);
  std::vector<float> means(3 * kPoints);
  for (std::size_t i = 0; i < means.size(); ++i) means[i] = static_cast<float>(random.below(i, 1000));
  means[0] = std::numeric_limits<float>::quiet_NaN();
  means[3] = 1e7f;  // an outlier
  std::vector<std::uint32_t> order(kPoints);
  spatial_order(means, order);
  EXPECT_EQ(order.back(), 0u);
  std::vector<std::uint32_t> sorted = order;
  std::sort(sorted.begin(), sorted.end());
  for (std::uint32_t i = 0; i < kPoints; ++i) ASSERT_EQ(sorted[i], i);

  const auto steps = [&](const auto& at) {
    double sum = 0;
    for (std::size_t k = 2; k + 2 < kPoints; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        const double d = static_cast<double>(means[3 * at(k) + c]) - static_cast<double>(means[3 * at(k - 1) + c]);
        if (std::isfinite(d)) sum += std::min(std::fabs(d), 1000.0);
      }
    }
    return sum;
  };
  EXPECT_LT(steps([&](std::size_t k) { return std::size_t{order[k]}; }), 0.2 * steps([](std::size_t k) { return k; }));
}

TEST(SpatialOrder, TakesNoPointsAndEqualOnes) {
  std::vector<std::uint32_t> order;
  spatial_order({}, order);
  order.resize(3);
  spatial_order(std::vector<float>(9, 2.5f), order);
  EXPECT_EQ(order, (std::vector<std::uint32_t>{0, 1, 2}));
  EXPECT_THROW(spatial_order(std::vector<float>(8), order), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test

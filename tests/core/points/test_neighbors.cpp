// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "reference/training.h"
#include "splatboost/neighbors.h"
#include "support/compare.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

std::vector<float> distances(const std::vector<float>& points, int k, int thread_count = 2) {
  Threads threads(thread_count);
  std::vector<float> result(points.size() / 3, -1);
  mean_squared_neighbor_distances(points, k, result, threads);
  return result;
}

void expect_exact(const std::vector<float>& points, int k) {
  const auto expected = reference::mean_squared_neighbor_distances({points.begin(), points.end()}, k);
  EXPECT_TRUE(is_close(distances(points, k), expected, {.relative = 1e-5, .scale = 0, .absolute = 1e-12, .l2 = 1e-5}));
}

TEST(Neighbors, AgreeWithBruteForce) {
  Numbers random(2);
  for (const std::size_t count : {2u, 3u, 4u, 5u, 33u, 700u}) {
    std::vector<float> points;
    for (std::size_t i = 0; i < 3 * count; ++i) points.push_back(random.real(-3, 5));
    for (const int k : {1, 3, 4, 10}) expect_exact(points, k);
  }
}

TEST(Neighbors, AgreeWithBruteForceInClumps) {
  Numbers random(3);
  std::vector<float> points;
  for (int i = 0; i < 600; ++i) {
    const double spread = random.magnitude(1e-3, 10);
    const double centre = i % 5;
    for (int axis = 0; axis < 3; ++axis) points.push_back(static_cast<float>(centre + random.uniform(-spread, spread)));
  }
  expect_exact(points, 3);
}

TEST(Neighbors, ALoneAPairAndNone) {
  EXPECT_EQ(distances({1, 2, 3}, 3), (std::vector<float>{0}));
  EXPECT_EQ(distances({0, 0, 0, 0, 3, 4}, 3), (std::vector<float>{25, 25}));
  EXPECT_TRUE(distances({}, 3).empty());
}

TEST(Neighbors, AnyNumberMayBeWanted) {
  const std::vector<float> points{0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3};
  EXPECT_EQ(distances(points, std::numeric_limits<int>::max()), distances(points, 3));
}

TEST(Neighbors, CoincidentPointsAreNeighboursAtDistanceZero) {
  // Two equal points and one at distance 3: with k = 2 the mean of 0 and 9.
  EXPECT_EQ(distances({0, 0, 0, 0, 0, 0, 3, 0, 0}, 2), (std::vector<float>{4.5f, 4.5f, 9}));
  const std::vector<float> same(3 * 50, 1.5f);
  EXPECT_EQ(distances(same, 3), std::vector<float>(50, 0));
}

TEST(Neighbors, ALatticeHasManyTies) {
  std::vector<float> points;
  for (int i = 0; i < 343; ++i) {
    for (const int coordinate : {i % 7, i / 7 % 7, i / 49}) points.push_back(static_cast<float>(coordinate));
  }
  EXPECT_EQ(distances(points, 3), std::vector<float>(343, 1));
}

TEST(Neighbors, PointsOnALine) {
  std::vector<float> points;
  for (int i = 0; i < 100; ++i) points.insert(points.end(), {static_cast<float>(i * i), 0, 0});
  expect_exact(points, 3);
}

}  // namespace
}  // namespace splatboost::test

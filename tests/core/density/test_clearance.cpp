// SPDX-License-Identifier: Apache-2.0
#include "splatboost/clearance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "splatboost/random.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

std::vector<float> in_a_cube(std::size_t count, std::uint64_t seed) {
  const RandomStream random(seed, 1, RandomPurpose::synth);
  std::vector<float> values(3 * count);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(4 * random.uniform(i) - 2);
  return values;
}

/// Points on the six walls of that cube.
std::vector<float> on_walls(std::size_t count, std::uint64_t seed) {
  std::vector<float> points = in_a_cube(count, seed);
  for (std::size_t i = 0; i < count; ++i) points[3 * i + i % 3] = i % 2 == 0 ? -2.0f : 2.0f;
  return points;
}

double distance(const std::vector<float>& a, std::size_t i, const std::vector<float>& b, std::size_t j) {
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double d = static_cast<double>(a[3 * i + k]) - static_cast<double>(b[3 * j + k]);
    sum += d * d;
  }
  return std::sqrt(sum);
}

std::vector<float> distances_of(const std::vector<float>& centres, const std::vector<float>& points,
                                int thread_count = 2) {
  Threads threads(thread_count);
  std::vector<float> distances(centres.size() / 3, -1);
  distances_to_scene(centres, points, distances, threads);
  return distances;
}

std::vector<float> clearances_of(const std::vector<float>& means, const std::vector<float>& centres,
                                 const std::vector<float>& distances, int thread_count = 2) {
  Threads threads(thread_count);
  std::vector<float> clearances(means.size() / 3, -1);
  camera_clearances(means, centres, distances, clearances, threads);
  return clearances;
}

TEST(DistancesToScene, AreThoseOfTheEleventhPointOrOfTheNearestThousandth) {
  const std::vector<float> centres = in_a_cube(3, 1);
  for (const std::size_t count : {500, 20000}) {
    const std::vector<float> points = on_walls(count, 2);
    const std::vector<float> found = distances_of(centres, points);
    for (std::size_t c = 0; c < 3; ++c) {
      std::vector<double> all;
      for (std::size_t p = 0; p < count; ++p) all.push_back(distance(centres, c, points, p));
      std::ranges::sort(all);
      EXPECT_NEAR(found[c], all[count == 20000 ? 20 : 10], 1e-5) << count;
    }
  }
}

// A street of 1 km with a camera at every metre, 2 m above it. A thousandth of its points is 12 m² of ground.
TEST(DistancesToScene, AreThoseOfTheGroundBelowInALongScene) {
  std::vector<float> points = in_a_cube(100000, 8), centres;  // in [-2, 2]
  for (std::size_t i = 0; i < points.size(); i += 3) {
    points[i] *= 250;
    points[i + 1] *= 3;
    points[i + 2] = 0;
  }
  for (int c = 0; c < 1000; ++c) centres.insert(centres.end(), {static_cast<float>(c - 500), 0, 2});
  EXPECT_LT(distances_of(centres, points)[500], 2.3f);
  EXPECT_GT(distances_of({0, 0, 2}, points)[0], 2.5f) << "a tenth of a camera's share must be less than a thousandth";
}

// Sparse clouds of a few points exist, and nobody draws so few at random.
TEST(PointsAreRandom, IsFalseForTooFewToTell) {
  for (const std::size_t count : {0, 1, 20, 63, 64, 511}) {
    EXPECT_FALSE(points_are_random(in_a_cube(count, 1))) << count;
    EXPECT_EQ(points_show_surfaces(in_a_cube(count, 1)), count >= 64) << count;
    EXPECT_EQ(points_show_surfaces(on_walls(count, 1)), count >= 64) << count;
  }
}

TEST(DistancesToScene, AreZeroWithTooFewPoints) {
  EXPECT_EQ(distances_of({0, 0, 0}, {}), std::vector<float>{0});
  EXPECT_EQ(distances_of({0, 0, 0}, std::vector<float>(3 * 63, 1.0f)), std::vector<float>{0});
  // Points that are not finite are no points.
  std::vector<float> points(3 * 64, 1.0f);
  EXPECT_GT(distances_of({0, 0, 0}, points)[0], 0.0f);
  points[4] = kNan;
  EXPECT_EQ(distances_of({0, 0, 0}, points), std::vector<float>{0});
}

// A scene without points starts from random ones, in a box that may be smaller than the scene (NeRF-synthetic's ±1.3).
TEST(DistancesToScene, AreZeroIfThePointsWereDrawnAtRandom) {
  for (const std::size_t count : {512, 1000, 5000, 100000}) {
    EXPECT_TRUE(points_are_random(in_a_cube(count, count))) << count;
    EXPECT_FALSE(points_show_surfaces(in_a_cube(count, count))) << count;
    EXPECT_EQ(distances_of({4, 0, 0}, in_a_cube(count, count)), std::vector<float>{0}) << count;
  }
  // Boxes that are not cubes, as for cameras that look at a long scene.
  std::vector<float> points = in_a_cube(5000, 3);
  for (std::size_t i = 0; i < points.size(); i += 3) points[i] *= 40;
  EXPECT_EQ(distances_of({4, 0, 0}, points), std::vector<float>{0});
  // Neither a room whose walls are sampled evenly nor a plane is random.
  for (const std::size_t count : {64, 100, 250, 512, 700, 1000, 5000}) {
    EXPECT_FALSE(points_are_random(on_walls(count, count))) << count;
    EXPECT_TRUE(points_show_surfaces(on_walls(count, count))) << count;
    EXPECT_GT(distances_of({0, 0, 0}, on_walls(count, count))[0], 1.5f) << count;
    std::vector<float> plane = in_a_cube(count, count);
    for (std::size_t i = 0; i < plane.size(); i += 3) plane[i] = 1;
    EXPECT_GT(distances_of({0, 0, 0}, plane)[0], 1.0f) << count;
  }
}

TEST(CameraClearances, AreRelativeToTheCameraWhoseSceneIsFarthest) {
  const std::vector<float> means = in_a_cube(3000, 3), centres = in_a_cube(7, 4);
  const std::vector<float> distances{0.5f, 2, 0, 1, 3, 0.01f, 1};
  const std::vector<float> found = clearances_of(means, centres, distances);
  for (std::size_t i = 0; i < found.size(); ++i) {
    double expected = kInfinity;
    for (std::size_t c = 0; c < distances.size(); ++c) {
      if (distances[c] > 0) expected = std::min(expected, distance(means, i, centres, c) / distances[c]);
    }
    ASSERT_NEAR(found[i], expected, 1e-5 * expected) << i;
  }
}

TEST(CameraClearances, AreInfiniteWithoutCameras) {
  EXPECT_EQ(clearances_of({1, 2, 3}, {}, {}), std::vector<float>{kInfinity});
  EXPECT_EQ(clearances_of({1, 2, 3}, {1, 2, 3}, {0}), std::vector<float>{kInfinity});
  EXPECT_EQ(clearances_of({kNan, 2, 3}, {1, 2, 3}, {1}), std::vector<float>{kInfinity});
}

TEST(CameraClearances, AreTheSameForAnyNumberOfThreads) {
  const std::vector<float> means = in_a_cube(5000, 5), centres = in_a_cube(40, 6);
  const std::vector<float> distances = distances_of(centres, on_walls(900, 7), 1);
  EXPECT_EQ(distances, distances_of(centres, on_walls(900, 7), 3));
  EXPECT_EQ(clearances_of(means, centres, distances, 1), clearances_of(means, centres, distances, 3));
}

TEST(CameraClearances, RefuseWrongShapes) {
  Threads threads(1);
  std::vector<float> one(1), three(3), four(4);
  EXPECT_THROW(distances_to_scene(four, three, one, threads), ArgumentError);
  EXPECT_THROW(distances_to_scene(three, four, one, threads), ArgumentError);
  EXPECT_THROW(camera_clearances(four, three, one, one, threads), ArgumentError);
  EXPECT_THROW(camera_clearances(three, four, one, one, threads), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test

// SPDX-License-Identifier: Apache-2.0
// Selections, orders and neighbours on a CUDA device: exactly those of the CPU.
#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "cuda/cuda_device.h"
#include "splatboost/device_array.h"
#include "splatboost/neighbors.h"
#include "splatboost/scores.h"
#include "splatboost/select.h"
#include "splatboost/spatial_order.h"
#include "splatboost/threads.h"
#include "splatboost/visibility.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

using CudaDecisions = OnCuda<>;
using Mask = std::vector<std::uint8_t>;

constexpr std::size_t kCount = 777;

Mask some(std::uint64_t seed, int of_ten) {
  Numbers random(seed);
  Mask mask;
  for (std::size_t i = 0; i < kCount; ++i) mask.push_back(random.bits() % 10 < static_cast<unsigned>(of_ten) ? 3 : 0);
  return mask;
}

/// Few values, so that there are ties; zeros of both signs.
std::vector<float> with_ties(std::uint64_t seed) {
  Numbers random(seed);
  std::vector<float> values;
  for (std::size_t i = 0; i < kCount; ++i)
    values.push_back(static_cast<float>(static_cast<int>(random.bits() % 7) - 3));
  values[11] = -0.0f;
  return values;
}

TEST_F(CudaDecisions, ImportantCandidatesStay) {
  std::vector<std::int64_t> importance(kCount);
  for (std::size_t i = 0; i < kCount; ++i) importance[i] = static_cast<std::int64_t>(i % 13);
  importance[7] = std::int64_t{1} << 40;
  const DeviceArray<std::int64_t> device_importance(stream(), importance);
  for (const double threshold : {-1.0, 5.0, 5.5, 1e9}) {
    Mask mask = some(1, 6);
    DeviceArray<std::uint8_t> device(stream(), mask);
    EXPECT_EQ(keep_important(device_importance.span(), threshold, device.span(), stream()),
              keep_important(importance, threshold, mask));
    EXPECT_EQ(device.to_host(), mask);
  }
}

TEST_F(CudaDecisions, WeightedSamplesAreDrawnAlike) {
  Numbers numbers(4);
  std::vector<float> weights;
  for (std::size_t i = 0; i < kCount; ++i) weights.push_back(i % 5 == 0 ? 0.0f : numbers.real(0, 1));
  const DeviceArray<float> device_weights(stream(), weights);
  for (const std::size_t keep : {0u, 1u, 100u, 400u, 776u, 5000u}) {
    const RandomStream random(keep, 600, RandomPurpose::prune);
    Mask mask = some(keep + 1, 6);
    DeviceArray<std::uint8_t> device(stream(), mask);
    keep_weighted_sample(weights, keep, random, mask);
    keep_weighted_sample(device_weights.span(), keep, random, device.span(), stream());
    EXPECT_EQ(device.to_host(), mask) << keep;
  }
}

TEST_F(CudaDecisions, TheLargestStayAndTiesGoByIndex) {
  const std::vector<float> priorities = with_ties(8);
  const DeviceArray<float> device_priorities(stream(), priorities);
  for (const std::size_t keep : {0u, 3u, 200u, 700u}) {
    Mask mask = some(keep + 2, 8);
    DeviceArray<std::uint8_t> device(stream(), mask);
    keep_largest(priorities, keep, mask);
    keep_largest(device_priorities.span(), keep, device.span(), stream());
    EXPECT_EQ(device.to_host(), mask) << keep;
  }
}

TEST_F(CudaDecisions, ACandidateOfTheLeastPriorityStaysWhereThereIsRoom) {
  std::vector<float> priorities(40, 2.0f);
  priorities[31] = -std::numeric_limits<float>::infinity();
  const DeviceArray<float> device_priorities(stream(), priorities);
  Mask mask(40, 0);
  mask[30] = mask[31] = 1;
  DeviceArray<std::uint8_t> device(stream(), mask);
  keep_largest(priorities, 2, mask);
  keep_largest(device_priorities.span(), 2, device.span(), stream());
  EXPECT_EQ(mask[31], 1);
  EXPECT_EQ(device.to_host(), mask);
}

TEST_F(CudaDecisions, OneIsSparedOfAll) {
  const std::vector<float> priorities = with_ties(9);
  const DeviceArray<float> device_priorities(stream(), priorities);
  for (const int of_ten : {0, 5, 10}) {
    Mask mask = some(3, of_ten);
    DeviceArray<std::uint8_t> device(stream(), mask);
    EXPECT_EQ(spare_one(device_priorities.span(), device.span(), stream()), spare_one(priorities, mask));
    EXPECT_EQ(device.to_host(), mask);
  }
  EXPECT_EQ(spare_one({}, {}, stream()), 0u);
}

TEST_F(CudaDecisions, ScoresAreThoseOfTheCpu) {
  Numbers random(6);
  ScoreSums sums;
  for (std::size_t i = 0; i < kCount; ++i) {
    sums.counts.push_back(static_cast<std::int64_t>(random.bits() % 1000));
    sums.weighted_counts.push_back(random.real(-1, 100));
  }
  const DeviceArray<std::int64_t> counts(stream(), sums.counts);
  DeviceArray<std::int64_t> device_importance(stream());
  device_importance.ensure(kCount);
  for (const int views : {0, 1, 10}) {
    sums.views = views;
    std::vector<std::int64_t> importance(kCount);
    importance_scores(sums, importance);
    importance_scores(counts.span(), views, device_importance.span(), stream());
    EXPECT_EQ(device_importance.to_host(), importance);
  }
  DeviceArray<float> device_scores(stream());
  for (const std::size_t n : {kCount, std::size_t{1}, std::size_t{0}}) {
    sums.weighted_counts.resize(n);
    std::vector<float> scores(n);
    pruning_scores(sums, scores);
    device_scores.ensure(n);
    pruning_scores(DeviceArray<double>(stream(), sums.weighted_counts).span(), device_scores.span(), stream());
    EXPECT_EQ(device_scores.to_host(), scores);
  }
}

TEST_F(CudaDecisions, WhatAViewSeesIsAsOnTheCpu) {
  Threads threads(1);
  const Camera camera = oblique_camera(70, 50);
  for (const bool covariances : {false, true}) {
    SceneSpec spec;
    spec.count = kCount;
    spec.colors = true;
    spec.covariances = covariances;
    SceneData scene = random_scene(camera, spec, 11);
    for (std::size_t i = 0; i < scene.means.size() / 2; ++i) scene.means[i] *= 3.0f;  // many outside of the image
    const DeviceArray<float> means(stream(), scene.means), scales(stream(), scene.scales),
        rotations(stream(), scene.rotations), given(stream(), scene.covariances);
    Gaussians gaussians = scene.view();
    gaussians.means = means.span();
    gaussians.scales = scales.span();
    gaussians.rotations = rotations.span();
    gaussians.covariances = given.span();
    std::vector<std::int32_t> radii(kCount);
    visible_radii(camera, scene.view(), {}, radii, threads);
    DeviceArray<std::int32_t> device_radii(stream());
    device_radii.ensure(kCount);
    visible_radii(camera, gaussians, {}, device_radii.span(), stream());
    std::size_t seen = 0, differ = 0;
    const std::vector<std::int32_t> found = device_radii.to_host();
    for (std::size_t i = 0; i < kCount; ++i) {
      seen += radii[i] > 0;
      differ += radii[i] != found[i];
    }
    EXPECT_GT(seen, 100u);
    EXPECT_LE(differ, 3u);  // a radius just below a whole pixel may become one larger

    Mask visible(kCount);
    mark_visible(camera, scene.means, 0.2f, visible, threads);
    DeviceArray<std::uint8_t> device_visible(stream());
    device_visible.ensure(kCount);
    mark_visible(camera, means.span(), 0.2f, device_visible.span(), stream());
    EXPECT_EQ(device_visible.to_host(), visible);
  }
}

std::vector<float> cloud(std::size_t n, std::uint64_t seed) {
  Numbers random(seed);
  std::vector<float> points;
  for (std::size_t i = 0; i < 3 * n; ++i) points.push_back(random.real(-3, 5));
  return points;
}

TEST_F(CudaDecisions, SpatialOrderIsThatOfTheCpu) {
  std::vector<float> points = cloud(900, 1);
  const auto expect_same = [&] {
    const std::size_t n = points.size() / 3;
    std::vector<std::uint32_t> order(n);
    spatial_order(points, order);
    DeviceArray<std::uint32_t> device(stream());
    device.ensure(n);
    spatial_order(DeviceArray<float>(stream(), points).span(), device.span(), stream());
    EXPECT_EQ(device.to_host(), order);
  };
  expect_same();
  points[31] = std::numeric_limits<float>::quiet_NaN();
  points[62] = std::numeric_limits<float>::infinity();
  for (std::size_t i = 300; i < 330; ++i) points[i] = points[i % 3];  // coincident
  expect_same();
  points.assign(30, 2.5f);
  expect_same();
  points.assign(30, std::numeric_limits<float>::quiet_NaN());
  expect_same();
  points.clear();
  expect_same();
}

TEST_F(CudaDecisions, NeighborsAreThoseOfTheCpu) {
  Threads threads(1);
  for (const std::size_t n : {0u, 1u, 2u, 5u, 600u}) {
    std::vector<float> points = cloud(n, n);
    for (std::size_t i = 30; i < points.size() && i < 60; ++i) points[i] = points[i % 3];  // coincident
    for (const int k : {1, 3, 8}) {
      std::vector<float> expected(n);
      mean_squared_neighbor_distances(points, k, expected, threads);
      DeviceArray<float> found(stream());
      found.ensure(n);
      mean_squared_neighbor_distances(DeviceArray<float>(stream(), points).span(), k, found.span(), stream());
      EXPECT_EQ(found.to_host(), expected) << n << " points, k " << k;
    }
  }
  EXPECT_THROW(mean_squared_neighbor_distances({}, 9, {}, stream()), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test

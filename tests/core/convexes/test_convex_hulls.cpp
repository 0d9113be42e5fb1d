// SPDX-License-Identifier: Apache-2.0
// Hulls that projection computes for blocks of convexes: of points on a grid, many of which coincide or are collinear,
// against hulls computed one by one; and of nearly collinear points.
#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <utility>
#include <vector>

#include "convexes/convex_frame.h"
#include "support/convex_scenes.h"
#include "support/instruction_sets.h"

namespace splatboost::test {
namespace {

/// Projects a point (x, y, 2) to (x, y) px from the principal point.
Camera grid_camera() {
  Camera camera;
  camera.width = 64;
  camera.height = 64;
  camera.fx = camera.fy = 2;
  camera.cx = camera.cy = 32;
  return camera;
}

/// Convexes of eight points, four of which mirror the others in x and y, so that the mean of these is exactly zero.
ConvexSceneData mirrored(std::size_t count, const auto& coordinate) {
  ConvexSceneData scene;
  scene.count = count;
  scene.points_per_convex = 8;
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<float> half;
    for (int k = 0; k < 8; ++k) half.push_back(coordinate(k));
    for (const float sign : {1.0f, -1.0f}) {
      for (std::size_t k = 0; k < 8; k += 2) {
        scene.points.insert(scene.points.end(), {sign * half[k], sign * half[k + 1], 2.0f});
      }
    }
  }
  scene.smoothness.assign(count, 0.1f);
  scene.sharpness.assign(count, 0.05f);
  scene.opacities.assign(count, 0.8f);
  scene.colors.assign(3 * count, 0.5f);
  return scene;
}

using Vertices = std::set<std::pair<float, float>>;

ProjectedConvex convex_of(const ConvexSceneData& scene, std::size_t i) {
  ProjectedConvex p;
  for (std::size_t k = 0; k < 8; ++k) {
    p.x[k] = scene.points[24 * i + 3 * k];
    p.y[k] = scene.points[24 * i + 3 * k + 1];
  }
  find_hull(p, 8);
  return p;
}

ConvexFrame projected(const ConvexSceneData& scene) {
  Threads threads(1);
  ConvexFrame frame;
  frame.camera = grid_camera();
  frame.options.box = ConvexBox::compact;
  frame.primitives = scene.count;
  frame.tiles_x = frame.camera.tiles_x();
  frame.tiles_y = frame.camera.tiles_y();
  project_convexes(frame, scene.view(), threads);
  return frame;
}

/// Twice the area of a hull.
double area_of(const ConvexSceneData& scene, std::size_t i, const std::uint8_t* hull, std::size_t edges) {
  double area = 0;
  for (std::size_t k = 0; k < edges; ++k) {
    const float* const a = &scene.points[24 * i + 3u * hull[k]];
    const float* const b = &scene.points[24 * i + 3u * hull[(k + 1) % edges]];
    area +=
        static_cast<double>(a[0]) * static_cast<double>(b[1]) - static_cast<double>(a[1]) * static_cast<double>(b[0]);
  }
  return area;
}

TEST(ConvexHulls, OfPointsOnAGridAreThoseOfOneAtATime) {
  Numbers random(3);
  for_each_target([&] {
    // Small integers, so that all products and sums are exact.
    const ConvexSceneData scene = mirrored(2000, [&](int) { return static_cast<float>(random.bits() % 7) - 3; });
    const ConvexFrame frame = projected(scene);
    std::size_t drawn = 0, degenerate = 0;
    for (std::size_t i = 0; i < scene.count; ++i) {
      const ProjectedConvex expected = convex_of(scene, i);
      if (expected.edges < 3) {
        ++degenerate;
        EXPECT_EQ(frame.visible[i], 0) << i;
        continue;
      }
      ASSERT_EQ(frame.visible[i], 1) << i;
      ++drawn;
      const ConvexRecord& record = frame.records[i];
      ASSERT_EQ(record.edges, static_cast<std::uint32_t>(expected.edges)) << i;
      const auto edges = static_cast<std::size_t>(record.edges);
      Vertices found, wanted;
      for (std::size_t k = 0; k < edges; ++k) {
        found.insert({scene.points[24 * i + 3u * record.hull[k]], scene.points[24 * i + 3u * record.hull[k] + 1]});
        wanted.insert({expected.x[expected.hull[k]], expected.y[expected.hull[k]]});
      }
      EXPECT_EQ(found, wanted) << i;
      EXPECT_EQ(area_of(scene, i, record.hull, edges), area_of(scene, i, expected.hull, edges)) << i;
    }
    EXPECT_GT(drawn, scene.count / 2);
    EXPECT_GT(degenerate, 0u);
  });
}

/// Parallelograms with a point on each side, which rounding moves inside or outside.
ConvexSceneData with_points_on_edges(std::size_t count, Numbers& random) {
  float half[8] = {};
  return mirrored(count, [&](int k) {
    if (k == 0) {
      do {
        for (float& v : half) v = random.real(-9, 9);
        // Not degenerate: the sides must not be nearly collinear.
      } while (std::abs(half[0] * half[3] - half[1] * half[2]) < 1.0f);
      const float t = random.real(0.05f, 0.95f), u = random.real(0.05f, 0.95f);
      for (int c = 0; c < 2; ++c) {
        half[4 + c] = half[c] + t * (half[2 + c] - half[c]);
        half[6 + c] = half[2 + c] + u * (-half[c] - half[2 + c]);
      }
    }
    return half[k];
  });
}

TEST(ConvexHulls, HaveNoVertexInTheMiddleOfAnEdge) {
  Numbers random(5);
  for_each_target([&] {
    const ConvexSceneData scene = with_points_on_edges(2000, random);
    const ConvexFrame frame = projected(scene);
    for (std::size_t i = 0; i < scene.count; ++i) {
      const ProjectedConvex alone = convex_of(scene, i);
      ASSERT_EQ(alone.edges, 4) << i;
      ASSERT_EQ(frame.visible[i], 1) << i;
      ASSERT_EQ(frame.records[i].edges, 4u) << i;
      for (std::size_t k = 0; k < 4; ++k) {
        // Corners are points 0, 1, 4 and 5.
        EXPECT_EQ(alone.hull[k] & 2, 0) << i;
        EXPECT_EQ(frame.records[i].hull[k] & 2, 0) << i;
      }
    }
  });
}

TEST(ConvexHulls, OfNearlyCollinearPointsAreSlivers) {
  Numbers random(4);
  for_each_target([&] {
    float slope = 0;
    float before = 0;
    const ConvexSceneData scene = mirrored(2000, [&](int k) {
      if (k == 0) slope = random.real(-1, 1);
      if (k % 2 == 0) return before = random.real(-9, 9);
      return slope * before * (1 + 1e-7f * static_cast<float>(random.bits() % 5));
    });
    const ConvexFrame frame = projected(scene);
    for (std::size_t i = 0; i < scene.count; ++i) {
      if (frame.visible[i] == 0) continue;
      const ConvexRecord& record = frame.records[i];
      ASSERT_GE(record.edges, 3u) << i;
      ASSERT_LE(record.edges, 8u) << i;
      EXPECT_NEAR(area_of(scene, i, record.hull, record.edges), 0.0, 2e-4) << i;
    }
  });
}

}  // namespace
}  // namespace splatboost::test

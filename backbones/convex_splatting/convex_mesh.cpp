// SPDX-License-Identifier: Apache-2.0
#include "convex_splatting/convex_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "convex_splatting/convex_shapes.h"
#include "splatboost/constants.h"
#include "splatboost/convex_training.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr double kNegligible = 1e-5;  // share of a convex's size

float sigmoid(float x) { return 1 / (1 + std::exp(-x)); }

std::uint8_t byte_of(float value) {
  return static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f)));
}

/// Appends the faces of the convex hull of six points: triples with all other points on one side. Of points in a plane,
/// this would hold for more triples than the hull has faces, which would overlap. Sides are therefore those of points
/// moved by a negligible amount along a curve that has no four points in a plane.
void append_hull(const std::array<glm::vec3, kConvexPoints>& points, std::uint32_t first,
                 std::vector<std::uint32_t>& triangles) {
  std::array<glm::dvec3, kConvexPoints> at;
  double size = 0;
  for (std::size_t p = 0; p < kConvexPoints; ++p) {
    at[p] = glm::dvec3(points[p]) - glm::dvec3(points[0]);
    size = std::max(size, glm::length(at[p]));
  }
  if (size == 0) return;
  for (std::size_t p = 0; p < kConvexPoints; ++p) {
    const double t = static_cast<double>(p + 1) / kConvexPoints;
    at[p] += kNegligible * size * glm::dvec3(t, t * t, t * t * t);
  }
  for (std::uint32_t a = 0; a < kConvexPoints; ++a) {
    for (std::uint32_t b = a + 1; b < kConvexPoints; ++b) {
      for (std::uint32_t c = b + 1; c < kConvexPoints; ++c) {
        const glm::dvec3 normal = glm::cross(at[b] - at[a], at[c] - at[a]);
        double least = 0, most = 0;
        for (std::uint32_t p = 0; p < kConvexPoints; ++p) {
          if (p == a || p == b || p == c) continue;
          const double side = glm::dot(normal, at[p] - at[a]);
          least = std::min(least, side);
          most = std::max(most, side);
        }
        if (least < 0 && most > 0) continue;  // not a face: points on both sides
        if (most > 0) {
          triangles.insert(triangles.end(), {first + a, first + c, first + b});
        } else {
          triangles.insert(triangles.end(), {first + a, first + b, first + c});
        }
      }
    }
  }
}

}  // namespace

TriangleMesh convex_mesh(const ConvexCloud& cloud) {
  TriangleMesh mesh;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float opacity = sigmoid(cloud.logit_opacities[i]);
    if (sigmoid(cloud.logit_masks[i]) <= kConvexMaskThreshold || opacity <= kMinAlpha) continue;
    const auto first = static_cast<std::uint32_t>(mesh.vertices());
    require(first < std::numeric_limits<std::uint32_t>::max() - kConvexPoints, "too many convexes for one mesh");
    std::array<glm::vec3, kConvexPoints> points;
    for (std::size_t p = 0; p < kConvexPoints; ++p) {
      for (int c = 0; c < 3; ++c) {
        points[p][c] = cloud.points[kConvexWidth * i + 3 * p + static_cast<std::size_t>(c)];
        mesh.positions.push_back(points[p][c]);
      }
      for (std::size_t c = 0; c < 3; ++c) mesh.colors.push_back(byte_of(0.5f + kShConstant * cloud.sh_dc[3 * i + c]));
      mesh.opacities.push_back(byte_of(opacity));
    }
    append_hull(points, first, mesh.triangles);
  }
  require(!mesh.triangles.empty(), "the model has no visible convexes");
  return mesh;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "convex_splatting/convex_shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace splatboost {

std::vector<float> spheres(std::span<const float> centres, std::span<const float> radii) {
  const double golden_angle = std::numbers::pi * (3 - std::sqrt(5.0));
  float unit[kConvexWidth];
  for (std::size_t k = 0; k < kConvexPoints; ++k) {
    const double z = 1 - 2 * static_cast<double>(k) / (kConvexPoints - 1);
    const double across = std::sqrt(std::max(0.0, 1 - z * z)), angle = golden_angle * static_cast<double>(k);
    unit[3 * k] = static_cast<float>(across * std::cos(angle));
    unit[3 * k + 1] = static_cast<float>(across * std::sin(angle));
    unit[3 * k + 2] = static_cast<float>(z);
  }
  std::vector<float> points(kConvexWidth * radii.size());
  for (std::size_t i = 0; i < radii.size(); ++i) {
    for (std::size_t k = 0; k < kConvexWidth; ++k) {
      points[kConvexWidth * i + k] = centres[3 * i + k % 3] + radii[i] * unit[k];
    }
  }
  return points;
}

std::vector<float> convex_centres(std::span<const float> points) {
  std::vector<float> centres(points.size() / kConvexPoints, 0.0f);
  for (std::size_t i = 0; i < centres.size() / 3; ++i) {
    for (std::size_t k = 0; k < kConvexWidth; ++k) {
      centres[3 * i + k % 3] += points[kConvexWidth * i + k] / static_cast<float>(kConvexPoints);
    }
  }
  return centres;
}

void child_points(std::span<const float> parent, std::size_t child, float size, std::span<float> to) {
  const std::vector<float> centre = convex_centres(parent);
  for (std::size_t k = 0; k < kConvexWidth; ++k) {
    to[k] = parent[3 * child + k % 3] + size * (parent[k] - centre[k % 3]);
  }
}

void longest_deviations(std::span<const float> points, std::span<float> longest) {
  const std::vector<float> centres = convex_centres(points);
  for (std::size_t i = 0; i < longest.size(); ++i) {
    float variance[3] = {};
    for (std::size_t k = 0; k < kConvexWidth; ++k) {
      const float away = points[kConvexWidth * i + k] - centres[3 * i + k % 3];
      variance[k % 3] += away * away / static_cast<float>(kConvexPoints);
    }
    longest[i] = std::sqrt(*std::max_element(variance, variance + 3));
  }
}

}  // namespace splatboost

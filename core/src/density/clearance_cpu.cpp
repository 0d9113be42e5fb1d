// SPDX-License-Identifier: Apache-2.0
#include "splatboost/clearance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include <glm/glm.hpp>

#include "density/clearance_math.h"
#include "density/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 1024;
constexpr std::size_t kWrongPoints = 10;     ///< points that may be wrong, at least
constexpr std::size_t kWrongShare = 1000;    ///< one of so many may be,
constexpr std::size_t kWrongPerCamera = 10;  ///< but at most one of so many of a camera's share of the points
constexpr std::size_t kPointsPerCell = 8;
constexpr std::size_t kFewestPoints = 8 * kPointsPerCell;  ///< that show surfaces: of 2³ cells
/// Fewest points that can be told from random ones, of 4³ cells. In 2³ cells, a closed surface fills each evenly too.
constexpr std::size_t kFewestRandomPoints = 64 * kPointsPerCell;
constexpr double kEvenDispersion = 2;  ///< 1 for points drawn at random, above 60 for those of eleven measured scenes
constexpr float kInfinity = std::numeric_limits<float>::infinity();

void check_cameras(std::span<const float> centres, std::span<const float> distances) {
  SPLATBOOST_CHECK(centres.size() == 3 * distances.size(), "centres must be [C,3] and distances [C]");
}

/// Points [M,3] that are finite.
std::vector<glm::vec3> finite_points(std::span<const float> points) {
  SPLATBOOST_CHECK(points.size() % 3 == 0, "points must be [M,3]");
  std::vector<glm::vec3> finite;
  finite.reserve(points.size() / 3);
  for (std::size_t p = 0; p < points.size(); p += 3) {
    const glm::vec3 point(points[p], points[p + 1], points[p + 2]);
    if (std::isfinite(point.x) && std::isfinite(point.y) && std::isfinite(point.z)) finite.push_back(point);
  }
  return finite;
}

/// Whether points fill their bounding box evenly, as if drawn at random.
bool are_random(const std::vector<glm::vec3>& points) {
  if (points.size() < kFewestRandomPoints) return false;
  // Counts of random points in a grid of cells have a variance near their mean. Surfaces leave most cells empty.
  const auto cells = static_cast<std::size_t>(std::cbrt(static_cast<double>(points.size() / kPointsPerCell)) + 1e-9);
  glm::dvec3 low(points[0]), high(points[0]);
  for (const glm::vec3& point : points) {
    low = glm::min(low, glm::dvec3(point));
    high = glm::max(high, glm::dvec3(point));
  }
  std::vector<std::size_t> counts(cells * cells * cells);
  for (const glm::vec3& point : points) {
    std::size_t cell = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double size = high[axis] - low[axis];
      const double at = size > 0 ? (static_cast<double>(point[axis]) - low[axis]) / size : 0;
      cell = cell * cells + std::min(static_cast<std::size_t>(at * static_cast<double>(cells)), cells - 1);
    }
    ++counts[cell];
  }
  const double mean = static_cast<double>(points.size()) / static_cast<double>(counts.size());
  double variance = 0;
  for (const std::size_t count : counts) {
    const double difference = static_cast<double>(count) - mean;
    variance += difference * difference / static_cast<double>(counts.size());
  }
  return variance < kEvenDispersion * mean;
}

}  // namespace

bool points_are_random(std::span<const float> points) { return are_random(finite_points(points)); }

bool points_show_surfaces(std::span<const float> points) {
  const std::vector<glm::vec3> finite = finite_points(points);
  return finite.size() >= kFewestPoints && !are_random(finite);
}

void distances_to_scene(std::span<const float> centres, std::span<const float> points, std::span<float> distances,
                        const Threads& threads) {
  check_cameras(centres, distances);
  SPLATBOOST_CHECK(points.size() % 3 == 0, "points must be [M,3]");
  const std::size_t count = points.size() / 3, share = std::max(kWrongShare, kWrongPerCamera * distances.size());
  const std::size_t wrong = std::max(kWrongPoints, count / share);
  if (!points_show_surfaces(points)) {
    std::ranges::fill(distances, 0.0f);
    return;
  }
  threads.for_range(distances.size(), 1, [&](std::size_t begin, std::size_t end) {
    std::vector<float> squares(count);
    for (std::size_t c = begin; c < end; ++c) {
      for (std::size_t p = 0; p < count; ++p) {
        const float x = points[3 * p] - centres[3 * c], y = points[3 * p + 1] - centres[3 * c + 1];
        const float z = points[3 * p + 2] - centres[3 * c + 2];
        const float square = x * x + y * y + z * z;
        squares[p] = std::isnan(square) ? kInfinity : square;
      }
      const auto nearest = squares.begin() + static_cast<std::ptrdiff_t>(wrong);
      std::nth_element(squares.begin(), nearest, squares.end());
      distances[c] = std::isfinite(*nearest) ? std::sqrt(*nearest) : 0.0f;
    }
  });
}

void camera_clearances(std::span<const float> means, std::span<const float> centres, std::span<const float> distances,
                       std::span<float> clearances, Device device) {
  check_cameras(centres, distances);
  SPLATBOOST_CHECK(means.size() == 3 * clearances.size(), "means must be [N,3] and clearances [N]");
  if (device.is_cuda()) return cuda::camera_clearances(means, centres, distances, clearances, device.stream());
  device.threads().for_range(clearances.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    // Separate coordinates and an inner loop over Gaussians, which the compiler vectorizes.
    std::array<float, kGrain> x, y, z, least;
    for (std::size_t first = begin; first < end; first += kGrain) {
      const std::size_t n = std::min(kGrain, end - first);
      for (std::size_t i = 0; i < n; ++i) {
        x[i] = means[3 * (first + i)];
        y[i] = means[3 * (first + i) + 1];
        z[i] = means[3 * (first + i) + 2];
        least[i] = kInfinity;
      }
      for (std::size_t c = 0; c < distances.size(); ++c) {
        const float cx = centres[3 * c], cy = centres[3 * c + 1], cz = centres[3 * c + 2], distance = distances[c];
        if (!(distance > 0)) continue;
        for (std::size_t i = 0; i < n; ++i) {
          least[i] = min_of(squared_clearance(x[i] - cx, y[i] - cy, z[i] - cz, distance), least[i]);
        }
      }
      for (std::size_t i = 0; i < n; ++i) clearances[first + i] = std::sqrt(least[i]);
    }
  });
}

}  // namespace splatboost

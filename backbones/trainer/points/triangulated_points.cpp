// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/triangulated_points.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include <glm/common.hpp>

#include "splatboost/clearance.h"
#include "trainer/features/feature_tracks.h"
#include "trainer/features/view_features.h"
#include "trainer/points/backdrop_points.h"
#include "trainer/points/gap_points.h"

namespace splatboost {
namespace {

constexpr std::size_t kLeast = 100;
constexpr double kSpacing = 0.025;      ///< × diagonal, of points on surfaces that are added to those of a dataset …
constexpr double kSpacingAlone = 0.01;  ///< … and where it has fewer than kLeast
constexpr double kSpacingBackdrop = 0.025;

/// Adds the colour of the photo at a pixel of ViewFeatures to `sums`.
void add_color(const ViewFeatures& features, const glm::dvec2& pixel, std::array<std::size_t, 3>& sums) {
  const auto width = static_cast<std::size_t>(features.view->camera.width);
  const auto height = static_cast<std::size_t>(features.view->camera.height);
  const auto index = [](double at, int size, std::size_t full) {
    return std::min(static_cast<std::size_t>(std::max(at, 0.0) * static_cast<double>(full) / size), full - 1);
  };
  const std::size_t column = index(pixel.x, features.width, width), row = index(pixel.y, features.height, height);
  for (std::size_t c = 0; c < 3; ++c) sums[c] += features.view->color[(c * height + row) * width + column];
}

void append(PointCloud& cloud, const glm::dvec3& position, const std::array<std::size_t, 3>& sums, std::size_t count) {
  for (int axis = 0; axis < 3; ++axis) cloud.positions.push_back(static_cast<float>(position[axis]));
  for (const std::size_t sum : sums) cloud.colors.push_back(static_cast<std::uint8_t>((sum + count / 2) / count));
}

enum class Kind { features, surfaces, all };

PointCloud triangulate(const Scene& scene, Kind kind, const Threads& threads) {
  // A camera that stands still shows the same at any time.
  std::vector<const View*> chosen;
  for (const View& view : scene.train) {
    const auto same = [&](const View* other) {
      return other->camera.camera_from_world == view.camera.camera_from_world;
    };
    if (std::ranges::none_of(chosen, same)) chosen.push_back(&view);
  }
  std::vector<ViewFeatures> features(chosen.size());
  threads.for_range(chosen.size(), 1, [&](std::size_t i, std::size_t) { features[i] = detect_features(*chosen[i]); });
  const auto pairs = neighbouring_views(features);
  const std::vector<TrackedPoint> tracked = track_points(features, pairs, threads);
  std::vector<glm::dvec3> positions;
  for (std::size_t i = 0; i < scene.points.size(); ++i) {
    const float* p = scene.points.positions.data() + 3 * i;
    positions.emplace_back(p[0], p[1], p[2]);
  }
  for (const TrackedPoint& point : tracked) positions.push_back(point.position);
  PointCloud cloud;
  if (positions.size() < kLeast) return cloud;

  for (const TrackedPoint& point : tracked) {
    std::array<std::size_t, 3> sums{};
    for (const auto& [view, number] : point.features) add_color(features[view], features[view].pixels[number], sums);
    append(cloud, point.position, sums, point.features.size());
  }
  if (kind == Kind::features) return cloud;
  const double spacing = scene.points.size() >= kLeast ? kSpacing : kSpacingAlone;
  const auto add = [&](const std::vector<GapPoint>& points) {
    for (const GapPoint& point : points) {
      std::array<std::size_t, 3> sums{};
      add_color(features[point.view], point.pixel, sums);
      append(cloud, point.position, sums, 1);
      positions.push_back(point.position);
    }
  };
  const std::uint8_t background = scene.white_background ? 255 : 0;
  add(fill_gaps(features, positions, pairs, spacing, background, threads));
  if (kind == Kind::all) add(backdrop_points(features, positions, kSpacingBackdrop, background, threads));
  return cloud;
}

}  // namespace

PointCloud triangulate_features(const Scene& scene, const Threads& threads) {
  return triangulate(scene, Kind::features, threads);
}

PointCloud triangulate_surfaces(const Scene& scene, const Threads& threads) {
  return triangulate(scene, Kind::surfaces, threads);
}

PointCloud triangulate_points(const Scene& scene, const Threads& threads) {
  return triangulate(scene, Kind::all, threads);
}

bool may_add_points(const Scene& scene) {
  return !scene.lacks_points && !moves(scene) && !points_are_random(scene.points.positions);
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/backdrop_points.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include <glm/geometric.hpp>
#include <glm/vec2.hpp>

#include "trainer/points/points_in_picture.h"

namespace splatboost {
namespace {

constexpr double kCameras = 2;  ///< radius of the sphere, × that of all cameras …
constexpr double kPoints = 2;   ///< … or × that of this part of the points
constexpr double kPartOfPoints = 0.99;

struct Sphere {
  glm::dvec3 centre{0.0};
  double radius = 0;

  Sphere(const std::vector<ViewFeatures>& views, std::span<const glm::dvec3> known) {
    for (const ViewFeatures& view : views) centre += view.centre / static_cast<double>(views.size());
    for (const ViewFeatures& view : views) radius = std::max(radius, kCameras * glm::length(view.centre - centre));
    std::vector<double> distances;
    for (const glm::dvec3& point : known) distances.push_back(glm::length(point - centre));
    if (distances.empty()) return;
    const auto part =
        distances.begin() + static_cast<std::ptrdiff_t>(kPartOfPoints * static_cast<double>(distances.size()));
    std::ranges::nth_element(distances, part);
    radius = std::max(radius, kPoints * *part);
  }

  /// Where the ray of a pixel leaves the sphere; the cameras are inside.
  glm::dvec3 exit(const ViewFeatures& view, const glm::dvec2& pixel) const {
    const glm::dvec3 direction = view.ray(pixel), from_centre = view.centre - centre;
    const double b = glm::dot(direction, from_centre), c = glm::dot(from_centre, from_centre) - radius * radius;
    return view.centre + direction * (std::sqrt(b * b - c) - b);
  }
};

/// Whether any view shows the background at a position.
bool is_background(const std::vector<ViewFeatures>& views, const glm::dvec3& position, std::uint8_t background) {
  return std::ranges::any_of(views, [&](const ViewFeatures& view) {
    const std::optional<Projected> shown = view.projected(position);
    return shown && is_valid(view, shown->pixel) && !needs_points(view, shown->pixel, background);
  });
}

}  // namespace

std::vector<GapPoint> backdrop_points(const std::vector<ViewFeatures>& views, std::span<const glm::dvec3> known,
                                      double spacing, std::uint8_t background, const Threads& threads) {
  const Sphere sphere(views, known);
  if (!(sphere.radius > 0)) return {};
  std::vector<glm::dvec3> positions(known.begin(), known.end());
  std::vector<GapPoint> points;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const ViewFeatures& view = views[v];
    const PictureGrid grid(view, spacing);
    PointsInPicture shown(view, grid.spacing);
    shown.add(positions, threads);
    for (std::size_t row = 0; row < grid.rows; ++row) {
      for (std::size_t column = 0; column < grid.columns; ++column) {
        const glm::dvec2 pixel = grid.pixel(row, column);
        if (!needs_points(view, pixel, background) || shown.shows_any(pixel, grid.spacing)) continue;
        const glm::dvec3 position = sphere.exit(view, pixel);
        if (is_background(views, position, background)) continue;
        points.push_back({position, v, pixel});
        positions.push_back(position);
      }
    }
  }
  return points;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/free_space.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "trainer/points/photo_difference.h"
#include "trainer/points/points_in_picture.h"

namespace splatboost {
namespace {
constexpr double kDiffers = 16;   ///< grey values, mean around a pixel
constexpr double kBehind = 1.05;  ///< × depth
}  // namespace

FreeSpace::FreeSpace(const std::vector<ViewFeatures>& views, std::span<const glm::dvec3> known, double spacing,
                     const Threads& threads)
    : views_(views), nearest_(views.size()) {
  threads.for_range(views.size(), 1, [&](std::size_t v, std::size_t) {
    const ViewFeatures& view = views[v];
    Nearest& nearest = nearest_[v];
    nearest.cell = PictureGrid(view, spacing).spacing;
    nearest.columns = static_cast<std::size_t>(view.width / nearest.cell) + 1;
    nearest.rows = static_cast<std::size_t>(view.height / nearest.cell) + 1;
    nearest.depths.assign(nearest.columns * nearest.rows, std::numeric_limits<float>::infinity());
    for (const glm::dvec3& point : known) {
      if (const std::optional<Projected> shown = view.projected(point)) {
        const auto column = static_cast<std::size_t>(shown->pixel.x / nearest.cell),
                   row = static_cast<std::size_t>(shown->pixel.y / nearest.cell);
        float& depth = nearest.depths[row * nearest.columns + column];
        depth = std::min(depth, static_cast<float>(shown->depth));
      }
    }
  });
}

float FreeSpace::Nearest::around(const glm::dvec2& pixel) const {
  const auto column = static_cast<std::size_t>(pixel.x / cell), row = static_cast<std::size_t>(pixel.y / cell);
  float depth = std::numeric_limits<float>::infinity();
  for (std::size_t r = row - std::min<std::size_t>(row, 1); r <= std::min(row + 1, rows - 1); ++r) {
    for (std::size_t c = column - std::min<std::size_t>(column, 1); c <= std::min(column + 1, columns - 1); ++c) {
      depth = std::min(depth, depths[r * columns + c]);
    }
  }
  return depth;
}

bool FreeSpace::contains(std::size_t view, const glm::dvec2& pixel, double depth) const {
  const glm::dvec3 position = views_[view].at_depth(pixel, depth);
  for (std::size_t other = 0; other < views_.size(); ++other) {
    if (other == view) continue;
    const std::optional<Projected> there = views_[other].projected(position);
    if (!there) continue;
    const auto nearest = static_cast<double>(nearest_[other].around(there->pixel));
    if (std::isinf(nearest) || !(nearest > kBehind * there->depth)) continue;
    const std::optional<double> difference = photo_difference(views_[view], pixel, depth, views_[other]);
    if (difference && *difference > kDiffers) return true;
  }
  return false;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/gap_points.h"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include "trainer/points/free_space.h"
#include "trainer/points/photo_difference.h"
#include "trainer/points/points_in_picture.h"

namespace splatboost {
namespace {

constexpr std::size_t kCandidates = 8;                ///< nearest points whose depths are tried
constexpr double kReach = 0.08;                       ///< × diagonal; pixels farther from all points get none
constexpr std::array kRefinements{0.5, 0.25, 0.125};  ///< parts of the range of depths by which a depth is changed
constexpr double kLargestRange = 0.16;                ///< × depth

/// Mean of the smaller half of the differences to the other views: in the others, something may stand in front.
/// Infinite if no other view sees the pixel.
double disagreement(const std::vector<ViewFeatures>& views, std::size_t view, const std::vector<std::size_t>& others,
                    const glm::dvec2& pixel, double depth) {
  std::vector<double> differences;
  for (const std::size_t other : others) {
    if (const auto found = photo_difference(views[view], pixel, depth, views[other])) differences.push_back(*found);
  }
  if (differences.empty()) return std::numeric_limits<double>::infinity();
  std::ranges::sort(differences);
  const std::size_t half = (differences.size() + 1) / 2;
  double sum = 0;
  for (std::size_t i = 0; i < half; ++i) sum += differences[i];
  return sum / static_cast<double>(half);
}

/// The depth at which the other views agree best with this one: one of the candidates, refined. The first if no other
/// view sees the pixel.
double best_depth(const std::vector<ViewFeatures>& views, std::size_t view, const std::vector<std::size_t>& others,
                  const glm::dvec2& pixel, const std::vector<double>& candidates) {
  double best = candidates.front(), least = std::numeric_limits<double>::infinity();
  const auto offer = [&](double depth) {
    const double value = disagreement(views, view, others, pixel, depth);
    if (value < least) {
      least = value;
      best = depth;
    }
  };
  for (const double candidate : candidates) offer(candidate);
  // Not a part of the depth itself: in front of a camera that is far away, a few per cent of it are a large part of the
  // scene, and a wrong depth often agrees as well as the right one.
  const auto [nearest, farthest] = std::ranges::minmax(candidates);
  const double range = std::min(farthest - nearest, kLargestRange * best);
  for (const double part : kRefinements) {
    const double centre = best;
    offer(centre - part * range);
    offer(centre + part * range);
  }
  return best;
}

/// The pixels of the grid where the picture shows no point near but some within reach, with a depth.
std::vector<GapPoint> gaps_of(const std::vector<ViewFeatures>& views, std::size_t v,
                              const std::vector<std::size_t>& others, const FreeSpace& free_space,
                              const PointsInPicture& shown, const PictureGrid& grid, std::uint8_t background,
                              const Threads& threads) {
  const ViewFeatures& view = views[v];
  const double reach = std::max(kReach * view.diagonal(), grid.spacing);
  std::vector<std::vector<GapPoint>> found(grid.rows);
  threads.for_range(grid.rows, 1, [&](std::size_t row, std::size_t) {
    for (std::size_t column = 0; column < grid.columns; ++column) {
      const glm::dvec2 pixel = grid.pixel(row, column);
      if (!needs_points(view, pixel, background) || shown.shows_any(pixel, grid.spacing)) continue;
      const std::vector<double> candidates = shown.depths_near(pixel, reach, kCandidates);
      if (candidates.empty()) continue;
      const double depth = best_depth(views, v, others, pixel, candidates);
      if (free_space.contains(v, pixel, depth)) continue;
      found[row].push_back({view.at_depth(pixel, depth), v, pixel});
    }
  });
  std::vector<GapPoint> points;
  for (const std::vector<GapPoint>& of_row : found) points.insert(points.end(), of_row.begin(), of_row.end());
  return points;
}

}  // namespace

std::vector<GapPoint> fill_gaps(const std::vector<ViewFeatures>& views, std::span<const glm::dvec3> known,
                                const std::vector<std::pair<std::size_t, std::size_t>>& pairs, double spacing,
                                std::uint8_t background, const Threads& threads) {
  std::vector<std::vector<std::size_t>> around(views.size());
  for (const auto& [a, b] : pairs) {
    around[a].push_back(b);
    around[b].push_back(a);
  }
  const FreeSpace free_space(views, known, spacing, threads);
  std::vector<glm::dvec3> positions(known.begin(), known.end());
  std::vector<GapPoint> points;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const PictureGrid grid(views[v], spacing);
    PointsInPicture shown(views[v], grid.spacing);
    shown.add(positions, threads);
    for (const GapPoint& gap : gaps_of(views, v, around[v], free_space, shown, grid, background, threads)) {
      positions.push_back(gap.position);
      points.push_back(gap);
    }
  }
  return points;
}

}  // namespace splatboost

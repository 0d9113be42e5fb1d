// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/spread_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include <glm/geometric.hpp>

namespace splatboost {
namespace {

constexpr std::size_t kCandidates = 5;                ///< nearest tracked points whose depths are tried
constexpr double kReach = 0.08;                       ///< × diagonal; pixels farther from all tracked points get none
constexpr std::array kRefinements{0.08, 0.04, 0.02};  ///< parts of a depth by which it is changed
constexpr int kPatch = 2;                             ///< px around a pixel that are compared
constexpr double kNarrowestStep = 2;                  ///< px, of the grid

/// A tracked point in a view.
struct Seen {
  glm::dvec2 pixel{0.0};
  double depth = 0;  ///< z in the view's camera
};

std::optional<double> grey_at(const ViewFeatures& view, const glm::dvec2& pixel) {
  const double x = pixel.x - 0.5, y = pixel.y - 0.5;
  const double left = std::floor(x), top = std::floor(y);
  if (!(left >= 0 && top >= 0 && left + 1 < view.width && top + 1 < view.height)) return std::nullopt;
  const auto width = static_cast<std::size_t>(view.width);
  const std::uint8_t* const p =
      view.grey.data() + static_cast<std::size_t>(top) * width + static_cast<std::size_t>(left);
  const double u = x - left, v = y - top;
  return (1 - v) * ((1 - u) * p[0] + u * p[1]) + v * ((1 - u) * p[width] + u * p[width + 1]);
}

/// Mean absolute difference of the grey values around a pixel at this depth to those of another view; none if that does
/// not see it.
std::optional<double> difference(const ViewFeatures& view, const glm::dvec2& pixel, double depth,
                                 const ViewFeatures& other) {
  double sum = 0;
  int count = 0;
  for (int dy = -kPatch; dy <= kPatch; ++dy) {
    for (int dx = -kPatch; dx <= kPatch; ++dx) {
      const glm::dvec2 at = pixel + glm::dvec2(dx, dy);
      const std::optional<double> here = grey_at(view, at);
      if (!here) continue;
      const glm::dvec3 p = other.to_camera(view.at_depth(at, depth));
      if (!(p.z > 0)) return std::nullopt;
      const std::optional<double> there = grey_at(other, other.project(p));
      if (!there) return std::nullopt;
      sum += std::abs(*here - *there);
      ++count;
    }
  }
  if (count == 0) return std::nullopt;
  return sum / count;
}

/// Mean of the smaller half of the differences to the other views: in the others, something may stand in front.
/// Infinite if no other view sees the pixel.
double disagreement(const std::vector<ViewFeatures>& views, std::size_t view, const std::vector<std::size_t>& others,
                    const glm::dvec2& pixel, double depth) {
  std::vector<double> differences;
  for (const std::size_t other : others) {
    if (const auto found = difference(views[view], pixel, depth, views[other])) differences.push_back(*found);
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
  for (const double share : kRefinements) {
    const double centre = best;
    offer(centre * (1 - share));
    offer(centre * (1 + share));
  }
  return best;
}

}  // namespace

std::vector<SpreadPoint> spread_points(const std::vector<ViewFeatures>& views, const std::vector<TrackedPoint>& tracked,
                                       const std::vector<std::pair<std::size_t, std::size_t>>& pairs, std::size_t count,
                                       const Threads& threads) {
  std::vector<std::vector<Seen>> seen(views.size());
  for (const TrackedPoint& point : tracked) {
    for (const auto& [view, number] : point.features) {
      seen[view].push_back({views[view].pixels[number], views[view].to_camera(point.position).z});
    }
  }
  std::vector<std::vector<std::size_t>> around(views.size());
  for (const auto& [a, b] : pairs) {
    around[a].push_back(b);
    around[b].push_back(a);
  }
  double area = 0;
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (!seen[v].empty()) area += static_cast<double>(views[v].width) * views[v].height;
  }
  const double step = std::max(kNarrowestStep, std::sqrt(area / static_cast<double>(count)));

  std::vector<std::vector<SpreadPoint>> found(views.size());
  threads.for_range(views.size(), 1, [&](std::size_t v, std::size_t) {
    if (seen[v].empty()) return;
    const double reach = kReach * std::hypot(views[v].width, views[v].height);
    std::vector<std::pair<double, std::size_t>> near(seen[v].size());
    for (double y = step / 2; y < views[v].height; y += step) {
      for (double x = step / 2; x < views[v].width; x += step) {
        const glm::dvec2 pixel(x, y);
        const auto index =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(views[v].width) + static_cast<std::size_t>(x);
        if (!views[v].valid.empty() && views[v].valid[index] == 0) continue;
        for (std::size_t i = 0; i < near.size(); ++i) near[i] = {glm::length(seen[v][i].pixel - pixel), i};
        const auto end = near.begin() + static_cast<std::ptrdiff_t>(std::min(kCandidates, near.size()));
        std::ranges::partial_sort(near, end);
        if (near.front().first > reach) continue;
        std::vector<double> candidates;
        for (auto i = near.begin(); i != end; ++i) candidates.push_back(seen[v][i->second].depth);
        const double depth = best_depth(views, v, around[v], pixel, candidates);
        found[v].push_back({views[v].at_depth(pixel, depth), v, pixel});
      }
    }
  });
  std::vector<SpreadPoint> points;
  for (const std::vector<SpreadPoint>& of_view : found) points.insert(points.end(), of_view.begin(), of_view.end());
  return points;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/gap_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include <glm/geometric.hpp>

namespace splatboost {
namespace {

constexpr std::size_t kCandidates = 8;                ///< nearest points whose depths are tried
constexpr double kReach = 0.08;                       ///< × diagonal; pixels farther from all points get none
constexpr std::array kRefinements{0.5, 0.25, 0.125};  ///< parts of the range of depths by which a depth is changed
constexpr double kLargestRange = 0.16;                ///< × depth
constexpr int kPatch = 2;                             ///< px around a pixel that are compared
constexpr double kNarrowestSpacing = 2;               ///< px
constexpr int kDarkest = 8;                           ///< grey values up to this one …
constexpr int kLightest = 247;                        ///< … and from this one on are taken for clipped

/// A point in a picture.
struct Seen {
  glm::dvec2 pixel{0.0};
  double depth = 0;  ///< z in the view's camera
};

/// The points that a picture shows, in square cells.
class Picture {
 public:
  Picture(const ViewFeatures& view, double spacing)
      : view_(view),
        spacing_(spacing),
        columns_(static_cast<std::size_t>(view.width / spacing) + 1),
        rows_(static_cast<std::size_t>(view.height / spacing) + 1),
        cells_(columns_ * rows_) {}

  void add(std::span<const glm::dvec3> positions, const Threads& threads) {
    // Projected in parallel, block by block.
    std::vector<std::optional<Seen>> block(std::min(positions.size(), kBlock));
    for (std::size_t begin = 0; begin < positions.size(); begin += kBlock) {
      const std::size_t size = std::min(kBlock, positions.size() - begin);
      threads.for_range(size, 1024, [&](std::size_t first, std::size_t last) {
        for (std::size_t i = first; i < last; ++i) block[i] = seen(positions[begin + i]);
      });
      for (std::size_t i = 0; i < size; ++i) {
        if (block[i]) cells_[row_of(block[i]->pixel) * columns_ + column_of(block[i]->pixel)].push_back(*block[i]);
      }
    }
  }

  /// Depths of at most kCandidates points within `reach`, the nearest first.
  std::vector<double> depths_near(const glm::dvec2& pixel, double reach) const {
    std::vector<std::pair<double, double>> near;  // distance, depth
    for_each_within(pixel, reach, [&](double distance, double depth) { near.emplace_back(distance, depth); });
    const std::size_t count = std::min(kCandidates, near.size());
    std::ranges::partial_sort(near, near.begin() + static_cast<std::ptrdiff_t>(count));
    std::vector<double> depths;
    for (std::size_t i = 0; i < count; ++i) depths.push_back(near[i].second);
    return depths;
  }

  bool shows_any(const glm::dvec2& pixel, double reach) const {
    bool any = false;
    for_each_within(pixel, reach, [&](double, double) { any = true; });
    return any;
  }

 private:
  static constexpr std::size_t kBlock = 1 << 16;

  std::optional<Seen> seen(const glm::dvec3& position) const {
    const glm::dvec3 in_camera = view_.to_camera(position);
    if (!(in_camera.z > 0)) return std::nullopt;
    const glm::dvec2 pixel = view_.project(in_camera);
    if (!(pixel.x >= 0 && pixel.y >= 0 && pixel.x < view_.width && pixel.y < view_.height)) return std::nullopt;
    return Seen{pixel, in_camera.z};
  }
  std::size_t column_of(const glm::dvec2& pixel) const {
    return std::min(static_cast<std::size_t>(std::max(pixel.x, 0.0) / spacing_), columns_ - 1);
  }
  std::size_t row_of(const glm::dvec2& pixel) const {
    return std::min(static_cast<std::size_t>(std::max(pixel.y, 0.0) / spacing_), rows_ - 1);
  }
  template <class Visit>
  void for_each_within(const glm::dvec2& pixel, double reach, Visit&& visit) const {
    for (std::size_t row = row_of(pixel - reach); row <= row_of(pixel + reach); ++row) {
      for (std::size_t column = column_of(pixel - reach); column <= column_of(pixel + reach); ++column) {
        for (const Seen& seen : cells_[row * columns_ + column]) {
          const double distance = glm::length(seen.pixel - pixel);
          if (distance < reach) visit(distance, seen.depth);
        }
      }
    }
  }

  const ViewFeatures& view_;
  double spacing_;
  std::size_t columns_, rows_;
  std::vector<std::vector<Seen>> cells_;
};

/// None outside of the picture and where it is masked.
std::optional<double> grey_at(const ViewFeatures& view, const glm::dvec2& pixel) {
  const double x = pixel.x - 0.5, y = pixel.y - 0.5;
  const double left = std::floor(x), top = std::floor(y);
  if (!(left >= 0 && top >= 0 && left + 1 < view.width && top + 1 < view.height)) return std::nullopt;
  const auto width = static_cast<std::size_t>(view.width);
  const std::size_t at = static_cast<std::size_t>(top) * width + static_cast<std::size_t>(left);
  if (!view.valid.empty()) {
    const std::uint8_t* const m = view.valid.data() + at;
    if (m[0] == 0 || m[1] == 0 || m[width] == 0 || m[width + 1] == 0) return std::nullopt;
  }
  const std::uint8_t* const p = view.grey.data() + at;
  const double u = x - left, v = y - top;
  return (1 - v) * ((1 - u) * p[0] + u * p[1]) + v * ((1 - u) * p[width] + u * p[width + 1]);
}

/// Mean absolute difference of the grey values around a pixel at this depth to those of another view; none if that does
/// not see all of them.
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

/// Whether the picture is black or white all around a pixel: clipped, or a plain backdrop. There all depths agree
/// equally well, and points would hang beside what stands in front.
bool is_clipped(const ViewFeatures& view, int x, int y) {
  std::uint8_t darkest = 255, lightest = 0;
  for (int row = std::max(y - kPatch, 0); row <= std::min(y + kPatch, view.height - 1); ++row) {
    for (int column = std::max(x - kPatch, 0); column <= std::min(x + kPatch, view.width - 1); ++column) {
      const auto at =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(view.width) + static_cast<std::size_t>(column);
      darkest = std::min(darkest, view.grey[at]);
      lightest = std::max(lightest, view.grey[at]);
    }
  }
  return lightest <= kDarkest || darkest >= kLightest;
}

/// The pixels of the grid where the picture shows no point near but some within reach, with a depth.
std::vector<GapPoint> gaps_of(const std::vector<ViewFeatures>& views, std::size_t v,
                              const std::vector<std::size_t>& others, const Picture& picture, double spacing,
                              const Threads& threads) {
  const ViewFeatures& view = views[v];
  const double reach = std::max(kReach * view.diagonal(), spacing);
  const auto count = [&](int size) { return static_cast<std::size_t>(std::max(0.0, std::ceil(size / spacing - 0.5))); };
  const std::size_t columns = count(view.width), rows = count(view.height);
  std::vector<std::vector<GapPoint>> found(rows);
  threads.for_range(rows, 1, [&](std::size_t row, std::size_t) {
    for (std::size_t column = 0; column < columns; ++column) {
      const glm::dvec2 pixel =
          spacing * (glm::dvec2(static_cast<double>(column), static_cast<double>(row)) + glm::dvec2(0.5));
      const auto index =
          static_cast<std::size_t>(pixel.y) * static_cast<std::size_t>(view.width) + static_cast<std::size_t>(pixel.x);
      if (!view.valid.empty() && view.valid[index] == 0) continue;
      if (!view.background.empty() && view.background[index] != 0) continue;
      if (is_clipped(view, static_cast<int>(pixel.x), static_cast<int>(pixel.y))) continue;
      if (picture.shows_any(pixel, spacing)) continue;
      const std::vector<double> candidates = picture.depths_near(pixel, reach);
      if (candidates.empty()) continue;
      found[row].push_back({view.at_depth(pixel, best_depth(views, v, others, pixel, candidates)), v, pixel});
    }
  });
  std::vector<GapPoint> points;
  for (const std::vector<GapPoint>& of_row : found) points.insert(points.end(), of_row.begin(), of_row.end());
  return points;
}

}  // namespace

std::vector<GapPoint> fill_gaps(const std::vector<ViewFeatures>& views, std::span<const glm::dvec3> known,
                                const std::vector<std::pair<std::size_t, std::size_t>>& pairs, double spacing,
                                const Threads& threads) {
  std::vector<std::vector<std::size_t>> around(views.size());
  for (const auto& [a, b] : pairs) {
    around[a].push_back(b);
    around[b].push_back(a);
  }
  std::vector<glm::dvec3> positions(known.begin(), known.end());
  std::vector<GapPoint> points;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const double pixels = std::max(kNarrowestSpacing, spacing * views[v].diagonal());
    Picture picture(views[v], pixels);
    picture.add(positions, threads);
    for (const GapPoint& gap : gaps_of(views, v, around[v], picture, pixels, threads)) {
      positions.push_back(gap.position);
      points.push_back(gap);
    }
  }
  return points;
}

}  // namespace splatboost

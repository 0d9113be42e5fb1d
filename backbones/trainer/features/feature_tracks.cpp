// SPDX-License-Identifier: Apache-2.0
#include "trainer/features/feature_tracks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <glm/vec2.hpp>

#include "trainer/features/nearest_to_lines.h"

namespace splatboost {
namespace {

constexpr std::array<std::size_t, 8> kNeighbours{0, 1, 2, 3, 5, 7, 10, 14};  ///< by rank of their distance
constexpr double kLeastCosine = 0.7;        ///< between the optical axes of two views that are matched
constexpr float kBand = 1.5f;               ///< px; largest distance to the epipolar line, and of a projected point
constexpr float kFarthest = 0.7f;           ///< largest distance of two descriptors of length 1
constexpr float kRatio = 0.85f;             ///< … and in units of the distance to the second nearest on the line
constexpr std::size_t kLeastViews = 3;      ///< of a point: two rays that almost meet may be those of different points
constexpr double kLargestCosine = 0.99966;  ///< of the largest angle between two rays of a point, 1.5°

/// The two smallest distances of a feature to features of another image, and the index of the nearest.
struct Nearest {
  int first = std::numeric_limits<int>::max(), second = first;  ///< squared
  std::size_t index = 0;

  void offer(int distance, std::size_t candidate) {
    if (distance < first) {
      second = std::exchange(first, distance);
      index = candidate;
    } else if (distance < second) {
      second = distance;
    }
  }
  bool clear() const {
    constexpr float kFarthestSquare = kFarthest * kFarthest * kDescriptorLength * kDescriptorLength;
    const auto nearest = static_cast<float>(first);
    return nearest < kFarthestSquare && nearest < kRatio * kRatio * static_cast<float>(second);
  }
};

int squared_distance(const std::uint8_t* a, const std::uint8_t* b) {
  int sum = 0;
  for (std::size_t k = 0; k < kDescriptorSize; ++k) {
    const int difference = static_cast<int>(a[k]) - static_cast<int>(b[k]);
    sum += difference * difference;
  }
  return sum;
}

/// A line in normalised image coordinates as one in pixels: K⁻ᵀ · line.
glm::dvec3 line_in_pixels(const ViewFeatures& view, const glm::dvec3& l) {
  return {l.x / view.fx, l.y / view.fy, l.z - l.x * view.cx / view.fx - l.y * view.cy / view.fy};
}

/// Mutually nearest features of two views near each other's epipolar lines, that are clearly nearer than the second.
std::vector<std::pair<std::size_t, std::size_t>> match(const ViewFeatures& a, const ViewFeatures& b) {
  const glm::dmat3 b_from_a = b.rotation * glm::transpose(a.rotation);
  const glm::dvec3 shift = b.rotation * (a.centre - b.centre);
  // The essential matrix is [shift]× · b_from_a.
  const auto line_in_b = [&](std::size_t i) {
    return line_in_pixels(b, glm::cross(shift, b_from_a * a.normalised(a.pixels[i])));
  };
  const auto line_in_a = [&](std::size_t j) {
    return line_in_pixels(a, glm::transpose(b_from_a) * glm::cross(b.normalised(b.pixels[j]), shift));
  };
  const std::size_t count = b.pixels.size();
  std::vector<float> x(count), y(count), steepness(count), distances(count);
  for (std::size_t j = 0; j < count; ++j) {
    x[j] = static_cast<float>(b.pixels[j].x);
    y[j] = static_cast<float>(b.pixels[j].y);
    steepness[j] = static_cast<float>(1 / glm::length(glm::dvec2(line_in_a(j))));
  }
  std::vector<Nearest> of_a(a.pixels.size()), of_b(count);
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    const glm::dvec3 line = line_in_b(i);
    const double length = glm::length(glm::dvec2(line));
    const auto lx = static_cast<float>(line.x / length), ly = static_cast<float>(line.y / length);
    const auto lz = static_cast<float>(line.z / length), size = static_cast<float>(length);
    // The larger of the distances to the lines in both images; their product with the line's length is the same.
    for (std::size_t j = 0; j < count; ++j) {
      distances[j] = std::abs(lx * x[j] + ly * y[j] + lz) * std::max(1.0f, size * steepness[j]);
    }
    const auto* descriptor = a.descriptors.data() + i * kDescriptorSize;
    for (std::size_t j = 0; j < count; ++j) {
      if (!(distances[j] < kBand)) continue;
      const int distance = squared_distance(descriptor, b.descriptors.data() + j * kDescriptorSize);
      of_a[i].offer(distance, j);
      of_b[j].offer(distance, i);
    }
  }
  std::vector<std::pair<std::size_t, std::size_t>> matches;
  for (std::size_t i = 0; i < of_a.size(); ++i) {
    if (of_a[i].clear() && of_b[of_a[i].index].clear() && of_b[of_a[i].index].index == i) {
      matches.emplace_back(i, of_a[i].index);
    }
  }
  return matches;
}

/// Sets of features that are connected by matches. Of two features of one view, which cannot show the same point, only
/// the first stays.
class Tracks {
 public:
  explicit Tracks(const std::vector<ViewFeatures>& views) {
    for (const ViewFeatures& view : views) {
      first_.push_back(features_.size());
      for (std::size_t k = 0; k < view.pixels.size(); ++k) features_.push_back({first_.size() - 1, k});
    }
    parent_.resize(features_.size());
    std::iota(parent_.begin(), parent_.end(), std::size_t{0});
  }

  void join(const Feature& a, const Feature& b) {
    const std::size_t root_a = root(first_[a.view] + a.number), root_b = root(first_[b.view] + b.number);
    parent_[std::max(root_a, root_b)] = std::min(root_a, root_b);
  }

  std::vector<std::vector<Feature>> list() {
    std::vector<std::vector<Feature>> of_root(features_.size());
    for (std::size_t i = 0; i < features_.size(); ++i) {
      std::vector<Feature>& track = of_root[root(i)];
      if (track.empty() || track.back().view != features_[i].view) track.push_back(features_[i]);
    }
    std::erase_if(of_root, [](const auto& track) { return track.size() < kLeastViews; });
    return of_root;
  }

 private:
  std::size_t root(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  std::vector<Feature> features_;
  std::vector<std::size_t> first_;   ///< [views] index of its first feature
  std::vector<std::size_t> parent_;  ///< [features]
};

/// Whether the rays of a track cross at a sufficient angle.
bool cross(const std::vector<glm::dvec3>& rays) {
  for (std::size_t i = 0; i < rays.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (glm::dot(rays[i], rays[j]) <= kLargestCosine) return true;
    }
  }
  return false;
}

/// Triangulates the features of a track and removes those that do not fit. @return whether enough remain
bool triangulate(const std::vector<ViewFeatures>& views, TrackedPoint& track) {
  std::vector<Feature>& features = track.features;
  glm::dvec3& point = track.position;
  std::vector<glm::dvec3> rays;
  for (const auto& [view, number] : features) rays.push_back(views[view].ray(views[view].pixels[number]));
  if (!cross(rays)) return false;
  while (features.size() >= kLeastViews) {
    // First with distances to the rays in world units, then approximately in pixels.
    for (const bool in_pixels : {false, true}) {
      NearestToLines nearest;
      for (std::size_t i = 0; i < features.size(); ++i) {
        const glm::dvec3 offset = point - views[features[i].view].centre;
        const double square = in_pixels ? glm::dot(offset, offset) : 1;
        nearest.add(views[features[i].view].centre, rays[i], square > 0 ? 1 / square : 0);
      }
      if (!(nearest.condition() > 0)) return false;
      point = nearest.point();
    }
    std::size_t worst = 0;
    double largest = 0;
    for (std::size_t i = 0; i < features.size(); ++i) {
      const double error = views[features[i].view].error(point, features[i].number);
      if (error > largest) {
        largest = error;
        worst = i;
      }
    }
    if (largest < static_cast<double>(kBand)) return cross(rays);
    features.erase(features.begin() + static_cast<std::ptrdiff_t>(worst));
    rays.erase(rays.begin() + static_cast<std::ptrdiff_t>(worst));
  }
  return false;
}

}  // namespace

std::vector<std::pair<std::size_t, std::size_t>> neighbouring_views(const std::vector<ViewFeatures>& views) {
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t a = 0; a < views.size(); ++a) {
    std::vector<std::pair<double, std::size_t>> near;
    for (std::size_t b = 0; b < views.size(); ++b) {
      const double distance = glm::length(views[a].centre - views[b].centre);
      if (distance > 0 && glm::dot(views[a].forward(), views[b].forward()) > kLeastCosine)
        near.emplace_back(distance, b);
    }
    std::ranges::sort(near);
    for (const std::size_t rank : kNeighbours) {
      if (rank >= near.size()) break;
      pairs.emplace_back(std::min(a, near[rank].second), std::max(a, near[rank].second));
    }
  }
  std::ranges::sort(pairs);
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

std::vector<TrackedPoint> track_points(const std::vector<ViewFeatures>& views,
                                       const std::vector<std::pair<std::size_t, std::size_t>>& pairs,
                                       const Threads& threads) {
  std::vector<std::vector<std::pair<std::size_t, std::size_t>>> matches(pairs.size());
  threads.for_range(pairs.size(), 1, [&](std::size_t i, std::size_t) {
    matches[i] = match(views[pairs[i].first], views[pairs[i].second]);
  });
  Tracks tracks(views);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    for (const auto& [a, b] : matches[i]) tracks.join({pairs[i].first, a}, {pairs[i].second, b});
  }
  std::vector<TrackedPoint> points;
  for (std::vector<Feature>& features : tracks.list()) points.push_back({{}, std::move(features)});
  threads.for_range(points.size(), 64, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (!triangulate(views, points[i])) points[i].features.clear();
    }
  });
  std::erase_if(points, [](const TrackedPoint& point) { return point.features.empty(); });
  return points;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "families/tracking/focal_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include <Eigen/Geometry>

namespace splatboost::tracking {
namespace {

constexpr std::array kFactors = {0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.12, 1.25, 1.4, 1.6, 1.8, 2.0, 2.25, 2.5};
constexpr double kFarOff = 1.2;         ///< factors closer to 1 are not reported
constexpr double kClearlyBetter = 0.7;  ///< × error with the given focal lengths
constexpr std::size_t kMinShared = 30;
constexpr std::size_t kKeptPercent = 60;  ///< share of a pair's points that is kept, those that fit best

struct Seen {
  Vec2 first, second;  ///< px from the principal point
  double first_depth, second_depth;
};

std::vector<Seen> shared_points(const SparseMap& map, std::size_t a, std::size_t b) {
  std::vector<Seen> shared;
  const MapKeyframe& first = map.keyframes()[a];
  const MapKeyframe& second = map.keyframes()[b];
  const Vec2 centre(map.optics().cx, map.optics().cy);
  for (std::size_t f = 0; f < first.points.size(); ++f) {
    if (first.points[f] < 0 || !(first.features.depths[f] > 0)) continue;
    const auto& sightings = map.point(first.points[f]).sightings;
    const auto other = sightings.find(b);
    if (other == sightings.end() || !(second.features.depths[other->second] > 0)) continue;
    shared.push_back({first.features.pixels[f] - centre, second.features.pixels[other->second] - centre,
                      first.features.depths[f], second.features.depths[other->second]});
  }
  return shared;
}

/// Median reprojection error, px, of the points kept (kKeptPercent) under the rigid motion that fits them best.
double error_of(const std::vector<Seen>& seen, double fx, double fy, double factor) {
  const auto place = [&](const Vec2& pixel, double depth) -> Vec3 {
    return Vec3(pixel.x() / (factor * fx), pixel.y() / (factor * fy), 1) * depth;
  };
  std::vector<std::size_t> kept(seen.size());
  for (std::size_t i = 0; i < kept.size(); ++i) kept[i] = i;
  std::vector<double> errors(seen.size());
  for (int round = 0; round < 3; ++round) {
    Eigen::Matrix3Xd from(3, kept.size()), to(3, kept.size());
    for (std::size_t i = 0; i < kept.size(); ++i) {
      const Seen& s = seen[kept[i]];
      from.col(static_cast<Eigen::Index>(i)) = place(s.first, s.first_depth);
      to.col(static_cast<Eigen::Index>(i)) = place(s.second, s.second_depth);
    }
    const Eigen::Matrix4d motion = Eigen::umeyama(from, to, false);
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const Vec3 p = (motion * place(seen[i].first, seen[i].first_depth).homogeneous()).head<3>();
      errors[i] = p.z() > 0 ? (Vec2(factor * fx * p.x(), factor * fy * p.y()) / p.z() - seen[i].second).norm()
                            : std::numeric_limits<double>::max();
    }
    kept.resize(seen.size());
    for (std::size_t i = 0; i < kept.size(); ++i) kept[i] = i;
    std::ranges::stable_sort(kept, {}, [&](std::size_t i) { return errors[i]; });
    kept.resize(kKeptPercent * seen.size() / 100);
  }
  return errors[kept[kept.size() / 2]];
}

}  // namespace

std::optional<double> better_focal_factor(const SparseMap& map) {
  std::array<double, kFactors.size()> sums{};
  for (std::size_t b = 1; b < map.keyframes().size(); ++b) {
    for (std::size_t a = b - std::min<std::size_t>(b, 3); a < b; ++a) {
      const std::vector<Seen> seen = shared_points(map, a, b);
      if (seen.size() < kMinShared) continue;
      for (std::size_t i = 0; i < kFactors.size(); ++i) {
        sums[i] += error_of(seen, map.optics().fx, map.optics().fy, kFactors[i]);
      }
    }
  }
  const auto best = std::ranges::min_element(sums);
  const double factor = kFactors[static_cast<std::size_t>(best - sums.begin())];
  const auto as_given = static_cast<std::size_t>(std::ranges::find(kFactors, 1.0) - kFactors.begin());
  const bool far = factor > kFarOff || factor < 1 / kFarOff;
  return far && *best < kClearlyBetter * sums[as_given] ? std::optional(factor) : std::nullopt;
}

}  // namespace splatboost::tracking

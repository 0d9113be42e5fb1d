// SPDX-License-Identifier: Apache-2.0
#include "families/tracking/sparse_map.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <opencv2/calib3d.hpp>

namespace splatboost::tracking {
namespace {

constexpr std::size_t kMaxMoving = 8;     ///< keyframes optimised in a local bundle adjustment
constexpr std::size_t kMaxStanding = 10;  ///< further keyframes, held constant
constexpr int kLocalIterations = 5;
constexpr int kRansacIterations = 300;
constexpr float kRansacPixels = 4;
constexpr std::size_t kComparedAtOnce = 30000;  ///< total number of descriptors of all keyframes compared
constexpr std::size_t kMinCompared = 100, kMaxCompared = 300;  ///< descriptors per keyframe
constexpr int kMinAlike = 10;                                  ///< matches of a similar keyframe

}  // namespace

Sighting sighting_of(const Features& features, std::size_t feature) {
  Sighting s;
  s.pixel = features.pixels[feature];
  s.depth = features.depths[feature];
  s.sigma = std::pow(kLevelFactor, features.levels[feature]);
  return s;
}

int SparseMap::add_point(const Vec3& position, double distance, std::size_t keyframe, std::size_t feature) {
  const MapKeyframe& by = keyframes_[keyframe];
  MapPoint added;
  added.position = position;
  added.descriptor = by.features.descriptors.row(static_cast<int>(feature));
  added.level = by.features.levels[feature];
  added.distance = distance;
  added.keyframe = keyframe;
  added.color = by.colors[feature];
  points_.push_back(std::move(added));
  const auto number = static_cast<int>(points_.size() - 1);
  add_sighting(number, keyframe, feature);
  return number;
}

void SparseMap::add_sighting(int point_number, std::size_t keyframe, std::size_t feature) {
  MapPoint& p = point(point_number);
  if (!p.sightings.emplace(keyframe, feature).second) return;
  keyframes_[keyframe].points[feature] = point_number;
}

void SparseMap::remove_sighting(int point_number, std::size_t keyframe) {
  MapPoint& p = point(point_number);
  const auto found = p.sightings.find(keyframe);
  if (found == p.sightings.end()) return;
  keyframes_[keyframe].points[found->second] = -1;
  p.sightings.erase(found);
  if (p.sightings.empty()) p.gone = true;
}

void SparseMap::merge(int from, int into) {
  if (from == into) return;
  const auto sightings = point(from).sightings;
  for (const auto& [keyframe, feature] : sightings) {
    remove_sighting(from, keyframe);
    add_sighting(into, keyframe, feature);
  }
  point(from).gone = true;
}

std::vector<std::pair<std::size_t, int>> SparseMap::covisible(std::size_t keyframe) const {
  std::map<std::size_t, int> shared;
  for (const int p : keyframes_[keyframe].points) {
    if (p < 0) continue;
    for (const auto& [other, feature] : point(p).sightings) ++shared[other];
  }
  shared.erase(keyframe);
  std::vector<std::pair<std::size_t, int>> sorted(shared.begin(), shared.end());
  std::ranges::stable_sort(sorted, [](const auto& a, const auto& b) { return a.second > b.second; });
  return sorted;
}

std::vector<int> SparseMap::seen_by(std::span<const std::size_t> keyframes) const {
  std::set<int> seen;
  for (const std::size_t keyframe : keyframes) {
    for (const int p : keyframes_[keyframe].points) {
      if (p >= 0) seen.insert(p);
    }
  }
  return {seen.begin(), seen.end()};
}

Sighting SparseMap::sighting(std::size_t keyframe, std::size_t feature) const {
  return sighting_of(keyframes_[keyframe].features, feature);
}

void SparseMap::adjust_around(std::size_t keyframe) {
  std::vector<std::size_t> moving{keyframe}, standing;
  for (const auto& [other, shared] : covisible(keyframe)) {
    if (moving.size() < kMaxMoving) {
      moving.push_back(other);
    } else if (standing.size() < kMaxStanding) {
      standing.push_back(other);
    }
  }
  std::map<std::size_t, int> others;
  for (const int p : seen_by(moving)) {
    for (const auto& [other, feature] : point(p).sightings) ++others[other];
  }
  std::vector<std::pair<std::size_t, int>> sorted(others.begin(), others.end());
  std::ranges::stable_sort(sorted, [](const auto& a, const auto& b) { return a.second > b.second; });
  for (const auto& [other, shared] : sorted) {
    if (standing.size() >= kMaxStanding) break;
    if (std::ranges::find(moving, other) == moving.end() && std::ranges::find(standing, other) == standing.end()) {
      standing.push_back(other);
    }
  }
  // Fixes the gauge by the oldest keyframe: at least one pose must be constant.
  if (standing.empty() || *std::ranges::min_element(moving) == 0) {
    const auto oldest = std::ranges::min_element(moving);
    standing.push_back(*oldest);
    moving.erase(oldest);
  }
  if (!moving.empty()) adjust_these(moving, standing, kLocalIterations);
}

void SparseMap::adjust_all(int iterations) {
  std::vector<std::size_t> moving;
  for (std::size_t i = 1; i < keyframes_.size(); ++i) moving.push_back(i);
  const std::size_t first = 0;
  if (!moving.empty()) adjust_these(moving, std::span(&first, 1), iterations);
}

void SparseMap::adjust_these(std::span<const std::size_t> moving, std::span<const std::size_t> standing,
                             int iterations) {
  Bundle bundle;
  std::map<std::size_t, std::size_t> place;
  for (const auto& [keyframes, fixed] : {std::pair(moving, 0), std::pair(standing, 1)}) {
    for (const std::size_t keyframe : keyframes) {
      place[keyframe] = bundle.poses.size();
      bundle.poses.push_back(keyframes_[keyframe].pose);
      bundle.fixed.push_back(static_cast<std::uint8_t>(fixed));
    }
  }
  std::vector<int> numbers;
  struct Where {
    int point;
    std::size_t keyframe;
  };
  std::vector<Where> where;
  for (const int number : seen_by(moving)) {
    const MapPoint& p = point(number);
    if (p.sightings.size() < 2) continue;  // not optimised; moves with the keyframe that created it, below
    for (const auto& [keyframe, feature] : p.sightings) {
      const auto found = place.find(keyframe);
      if (found == place.end()) continue;
      Sighting s = sighting(keyframe, feature);
      s.camera = found->second;
      s.point = numbers.size();
      // The optimiser cannot recover points behind a camera.
      if (!std::isfinite(squared_error(optics_, bundle.poses[s.camera], p.position, s))) continue;
      bundle.sightings.push_back(s);
      where.push_back({number, keyframe});
    }
    numbers.push_back(number);
    bundle.points.push_back(p.position);
  }
  std::vector<Pose> before;
  for (const MapKeyframe& keyframe : keyframes_) before.push_back(keyframe.pose);
  adjust(optics_, bundle, iterations);
  for (const std::size_t keyframe : moving) keyframes_[keyframe].pose = bundle.poses[place[keyframe]];
  for (std::size_t i = 0; i < numbers.size(); ++i) point(numbers[i]).position = bundle.points[i];
  for (MapPoint& p : points_) {
    if (p.gone || p.sightings.size() >= 2 || !place.contains(p.keyframe)) continue;
    p.position = keyframes_[p.keyframe].pose.inverse() * (before[p.keyframe] * p.position);
  }
  for (std::size_t i = 0; i < where.size(); ++i) {
    const Sighting& s = bundle.sightings[i];
    if (squared_error(optics_, bundle.poses[s.camera], bundle.points[s.point], s) > likely_error(s)) {
      remove_sighting(where[i].point, where[i].keyframe);
    }
  }
}

std::vector<Expected> expected_in(const SparseMap& map, const Pose& pose, std::span<const int> points, double radius,
                                  std::vector<int>& visible) {
  std::vector<Expected> expected;
  visible.clear();
  for (const int number : points) {
    const MapPoint& p = map.point(number);
    if (p.gone) continue;
    const Vec3 seen = pose * p.position;
    if (seen.z() < 0.05) continue;
    Expected wanted;
    wanted.place = map.optics().project(seen);
    if (!map.optics().contains(wanted.place)) continue;
    const double steps = std::log(p.distance / seen.norm()) / std::log(kLevelFactor);
    wanted.level = std::clamp(p.level + static_cast<int>(std::lround(steps)), 0, kLevels - 1);
    wanted.radius = radius * std::pow(kLevelFactor, wanted.level);
    wanted.descriptor = p.descriptor;
    expected.push_back(wanted);
    visible.push_back(number);
  }
  return expected;
}

std::size_t refine(const SparseMap& map, const Features& features, std::vector<int>& point_of_feature, Pose& pose) {
  std::vector<Vec3> points;
  std::vector<Sighting> sightings;
  std::vector<std::size_t> of;
  for (std::size_t f = 0; f < point_of_feature.size(); ++f) {
    if (point_of_feature[f] < 0) continue;
    Sighting s = sighting_of(features, f);
    s.point = points.size();
    points.push_back(map.point(point_of_feature[f]).position);
    sightings.push_back(s);
    of.push_back(f);
  }
  std::vector<std::uint8_t> fits;
  const std::size_t count = refine_pose(map.optics(), points, sightings, pose, fits);
  for (std::size_t i = 0; i < of.size(); ++i) {
    if (count == 0 || fits[i] == 0) point_of_feature[of[i]] = -1;
  }
  return count;
}

bool locate(const SparseMap& map, const Features& features, std::vector<int>& point_of_feature, Pose& pose,
            std::size_t least) {
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> pixels;
  std::vector<std::size_t> of;
  for (std::size_t f = 0; f < point_of_feature.size(); ++f) {
    if (point_of_feature[f] < 0) continue;
    const Vec3& p = map.point(point_of_feature[f]).position;
    points.emplace_back(p.x(), p.y(), p.z());
    pixels.emplace_back(features.pixels[f].x(), features.pixels[f].y());
    of.push_back(f);
  }
  if (points.size() < std::max<std::size_t>(least, 6)) return false;
  const Optics& o = map.optics();
  const cv::Matx33d camera(o.fx, 0, o.cx, 0, o.fy, o.cy, 0, 0, 1);
  cv::Vec3d turn, move;
  std::vector<int> inliers;
  try {
    if (!cv::solvePnPRansac(points, pixels, camera, cv::noArray(), turn, move, false, kRansacIterations, kRansacPixels,
                            0.99, inliers, cv::SOLVEPNP_EPNP)) {
      return false;
    }
  } catch (const cv::Exception&) {  // degenerate points, collinear or coincident
    return false;
  }
  if (inliers.size() < least) return false;
  const Vec3 axis(turn[0], turn[1], turn[2]);
  const double angle = axis.norm();
  pose.rotation =
      angle > 1e-12 ? Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis / angle)) : Eigen::Quaterniond::Identity();
  pose.translation = {move[0], move[1], move[2]};
  std::vector<std::uint8_t> in(of.size(), 0);
  for (const int i : inliers) in[static_cast<std::size_t>(i)] = 1;
  for (std::size_t i = 0; i < of.size(); ++i) {
    if (in[i] == 0) point_of_feature[of[i]] = -1;
  }
  return refine(map, features, point_of_feature, pose) >= least;
}

std::vector<std::size_t> similar_keyframes(const SparseMap& map, const Features& features,
                                           std::span<const std::size_t> among, std::size_t count) {
  if (among.empty()) return {};
  // Compare the first features only: they are the strongest and spread over the image.
  const auto rows = static_cast<int>(std::clamp(kComparedAtOnce / among.size(), kMinCompared, kMaxCompared));
  const auto first_rows = [&](const cv::Mat& descriptors) {
    return descriptors.rowRange(0, std::min(rows, descriptors.rows));
  };
  std::vector<std::pair<int, std::size_t>> alike;
  for (const std::size_t keyframe : among) {
    const std::vector<int> matches =
        match_descriptors(first_rows(features.descriptors), first_rows(map.keyframes()[keyframe].features.descriptors));
    const auto number = static_cast<int>(std::ranges::count_if(matches, [](int m) { return m >= 0; }));
    if (number >= kMinAlike) alike.emplace_back(-number, keyframe);
  }
  std::ranges::sort(alike);
  std::vector<std::size_t> best;
  for (std::size_t i = 0; i < std::min(count, alike.size()); ++i) best.push_back(alike[i].second);
  return best;
}

}  // namespace splatboost::tracking

// SPDX-License-Identifier: Apache-2.0
#include "families/tracking/loop_closing.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <span>
#include <utility>

namespace splatboost::tracking {
namespace {

constexpr std::size_t kMinApart = 10;  ///< minimum number of keyframes between the two visits of a place
constexpr std::size_t kCandidates = 2;
constexpr std::size_t kNeighbours = 8;
constexpr std::size_t kMatchedNeighbours = 3;  ///< number of neighbours to match descriptors with
constexpr int kConnected = 15;                 ///< minimum number of shared points of keyframes at the same place
constexpr std::size_t kFirstFits = 20;         ///< minimum number of inliers when matching by descriptors alone
constexpr std::size_t kFits = 40;              ///< the same after the search by projection
/// Minimum share of the expected points that are found: where only a pattern repeats, fewer are.
constexpr double kFoundShare = 0.3;
constexpr double kSearchRadius = 8;  ///< px
/// Maximum drift, to reject different places that look alike: metres per metre travelled, its minimum in metres, and
/// the rotation in radians.
constexpr double kDrift = 0.1, kMinDrift = 0.1, kMaxTurn = 0.35;
constexpr double kMaxAway = 1.0;          ///< radians between viewing directions of the same place
constexpr std::size_t kScalePoints = 15;  ///< minimum number of points mapped twice that the scale is measured with
constexpr int kEdgeShared = 30;           ///< minimum number of shared points for an edge of the pose graph
constexpr int kFinalIterations = 8;

/// `keyframe` and the keyframes that share most points with it.
std::vector<std::size_t> neighbourhood(const SparseMap& map, std::size_t keyframe) {
  std::vector<std::size_t> around{keyframe};
  for (const auto& [other, shared] : map.covisible(keyframe)) {
    if (around.size() > kNeighbours || shared < kConnected) break;
    around.push_back(other);
  }
  return around;
}

std::size_t count_of(const std::vector<int>& points) {
  return static_cast<std::size_t>(std::ranges::count_if(points, [](int p) { return p >= 0; }));
}

/// Upper bounds for the position error of `keyframe` relative to each earlier keyframe, metres.
std::vector<double> possible_drifts(const SparseMap& map, std::size_t keyframe) {
  std::vector<double> drifts(keyframe);
  double way = 0;
  for (std::size_t i = keyframe; i-- > 0;) {
    way += (map.keyframes()[i + 1].pose.centre() - map.keyframes()[i].pose.centre()).norm();
    drifts[i] = kMinDrift + kDrift * way;
  }
  return drifts;
}

/// Median ratio of the depths of points that were mapped twice, seen from the keyframe that returned.
std::optional<double> scale_of(const SparseMap& map, const Loop& loop) {
  const MapKeyframe& keyframe = map.keyframes()[loop.keyframe];
  std::vector<double> ratios;
  for (std::size_t f = 0; f < loop.point_of_feature.size(); ++f) {
    if (loop.point_of_feature[f] < 0 || keyframe.points[f] < 0) continue;
    const double then = (loop.pose * map.point(loop.point_of_feature[f]).position).z();
    const double now = (keyframe.pose * map.point(keyframe.points[f]).position).z();
    if (then > 0 && now > 0) ratios.push_back(then / now);
  }
  if (ratios.size() < kScalePoints) return std::nullopt;
  return median_of(std::move(ratios));
}

std::optional<Loop> verify(const SparseMap& map, std::size_t keyframe, std::size_t earlier) {
  const Features& features = map.keyframes()[keyframe].features;
  Loop loop;
  loop.keyframe = keyframe;
  loop.earlier = earlier;
  loop.point_of_feature.assign(features.size(), -1);
  std::set<int> used;
  const std::vector<std::size_t> around = neighbourhood(map, earlier);
  for (const std::size_t near : std::span(around).first(std::min(kMatchedNeighbours, around.size()))) {
    const MapKeyframe& other = map.keyframes()[near];
    const std::vector<int> matches = match_descriptors(features.descriptors, other.features.descriptors);
    for (std::size_t f = 0; f < matches.size(); ++f) {
      if (matches[f] < 0 || loop.point_of_feature[f] >= 0) continue;
      const int p = other.points[static_cast<std::size_t>(matches[f])];
      if (p >= 0 && used.insert(p).second) loop.point_of_feature[f] = p;
    }
  }
  if (!locate(map, features, loop.point_of_feature, loop.pose, kFirstFits)) return std::nullopt;
  // Find more points of the place by projection.
  std::vector<int> known = map.seen_by(around), visible;
  const std::set<int> matched(loop.point_of_feature.begin(), loop.point_of_feature.end());
  std::erase_if(known, [&](int p) { return matched.contains(p); });
  const std::vector<Expected> expected = expected_in(map, loop.pose, known, kSearchRadius, visible);
  const std::vector<int> found = match_expected(expected, features, FeatureGrid(features));
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (found[i] < 0) continue;
    int& p = loop.point_of_feature[static_cast<std::size_t>(found[i])];
    if (p < 0) p = visible[i];
  }
  const std::size_t fits = refine(map, features, loop.point_of_feature, loop.pose);
  const std::size_t looked_for = std::min(expected.size() + matched.size(), features.size());
  if (fits < kFits || static_cast<double>(fits) < kFoundShare * static_cast<double>(looked_for)) return std::nullopt;
  const Pose& seems = map.keyframes()[keyframe].pose;
  if ((loop.pose.centre() - seems.centre()).norm() > possible_drifts(map, keyframe)[earlier]) return std::nullopt;
  if (angle_between(loop.pose, seems) > kMaxTurn) return std::nullopt;
  if (!map.metric()) {
    const std::optional<double> scale = scale_of(map, loop);
    if (!scale) return std::nullopt;
    loop.scale = *scale;
  }
  return loop;
}

std::vector<Edge> edges_of(const SparseMap& map) {
  const std::vector<MapKeyframe>& keyframes = map.keyframes();
  std::vector<Edge> edges;
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    for (const auto& [other, shared] : map.covisible(i)) {
      if (other >= i || (shared < kEdgeShared && other + 1 != i)) continue;
      edges.push_back({other, i, keyframes[i].pose * keyframes[other].pose.inverse(), std::sqrt(shared / 100.0)});
    }
    // Connects consecutive keyframes even where they share no points.
    if (i > 0) edges.push_back({i - 1, i, keyframes[i].pose * keyframes[i - 1].pose.inverse(), 0.3});
  }
  return edges;
}

}  // namespace

std::optional<Loop> find_loop(const SparseMap& map, std::size_t keyframe) {
  std::set<std::size_t> connected{keyframe};
  for (const std::size_t near : neighbourhood(map, keyframe)) {
    for (const auto& [other, shared] : map.covisible(near)) {
      if (shared >= kConnected) connected.insert(other);
    }
  }
  const std::vector<double> drifts = possible_drifts(map, keyframe);
  std::vector<std::size_t> among;
  for (std::size_t i = 0; i + kMinApart < keyframe; ++i) {
    if (connected.contains(i)) continue;
    const MapKeyframe &now = map.keyframes()[keyframe], &then = map.keyframes()[i];
    const double away = (now.pose.centre() - then.pose.centre()).norm();
    if (away > drifts[i] + 0.5 * now.median_depth) continue;
    if (angle_between(now.pose, then.pose) < kMaxAway + kMaxTurn) among.push_back(i);
  }
  for (const std::size_t earlier : similar_keyframes(map, map.keyframes()[keyframe].features, among, kCandidates)) {
    if (std::optional<Loop> loop = verify(map, keyframe, earlier)) return loop;
  }
  return std::nullopt;
}

void close_loop(SparseMap& map, const Loop& loop) {
  std::vector<MapKeyframe>& keyframes = map.keyframes();
  std::vector<Pose> before;
  before.reserve(keyframes.size());
  for (const MapKeyframe& keyframe : keyframes) before.push_back(keyframe.pose);
  std::vector<Edge> edges = edges_of(map);
  Pose closing = loop.pose * before[loop.earlier].inverse();
  closing.translation /= loop.scale;
  edges.push_back({loop.earlier, loop.keyframe, closing,
                   2 * std::sqrt(static_cast<double>(count_of(loop.point_of_feature)) / 100.0), 1 / loop.scale});
  std::vector<Pose> after = before;
  std::vector<double> scales(keyframes.size(), 1);
  relax_pose_graph(after, edges, map.metric() ? nullptr : &scales);
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    keyframes[i].pose = after[i];
    keyframes[i].median_depth *= scales[i];
    keyframes[i].scale *= scales[i];
  }
  for (MapPoint& p : map.points()) {
    p.position = after[p.keyframe].inverse() * (scales[p.keyframe] * (before[p.keyframe] * p.position));
    p.distance *= scales[p.keyframe];
  }

  // Merge duplicate points, first in the keyframe that returned, then in its neighbours.
  const auto join = [&](std::size_t keyframe, std::size_t feature, int earlier_point) {
    if (map.point(earlier_point).gone) return;
    const int now = keyframes[keyframe].points[feature];
    if (now >= 0) {
      map.merge(now, earlier_point);
    } else {
      map.add_sighting(earlier_point, keyframe, feature);
    }
  };
  for (std::size_t f = 0; f < loop.point_of_feature.size(); ++f) {
    if (loop.point_of_feature[f] >= 0) join(loop.keyframe, f, loop.point_of_feature[f]);
  }
  const std::vector<int> earlier_points = map.seen_by(neighbourhood(map, loop.earlier));
  for (const std::size_t near : neighbourhood(map, loop.keyframe)) {
    const MapKeyframe& keyframe = keyframes[near];
    std::vector<int> candidates = earlier_points, visible;
    std::erase_if(candidates, [&](int p) { return map.point(p).gone || map.point(p).sightings.contains(near); });
    const std::vector<Expected> expected = expected_in(map, keyframe.pose, candidates, kSearchRadius, visible);
    const std::vector<int> found = match_expected(expected, keyframe.features, FeatureGrid(keyframe.features));
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (found[i] < 0) continue;
      const auto feature = static_cast<std::size_t>(found[i]);
      const Sighting s = map.sighting(near, feature);
      if (squared_error(map.optics(), keyframe.pose, map.point(visible[i]).position, s) > likely_error(s)) continue;
      join(near, feature, visible[i]);
    }
  }
  map.adjust_all(kFinalIterations);
}

}  // namespace splatboost::tracking

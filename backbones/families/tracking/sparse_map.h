// SPDX-License-Identifier: Apache-2.0
/// @file Sparse map: keyframes and the points that they observe.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "families/tracking/adjustment.h"
#include "families/tracking/features.h"
#include "families/tracking/pose.h"

namespace splatboost::tracking {

using Color = std::array<std::uint8_t, 3>;

struct MapPoint {
  Vec3 position = Vec3::Zero();                  ///< world
  cv::Mat descriptor;                            ///< [1,32]
  int level = 0;                                 ///< pyramid level at which it was detected …
  double distance = 1;                           ///< … from this distance, metres
  std::size_t keyframe = 0;                      ///< that created it
  std::map<std::size_t, std::size_t> sightings;  ///< keyframe → feature
  Color color{};
  int expected = 1, found = 1;  ///< frames in which it should have been seen, frames in which it was
  bool gone = false;            ///< removed or merged; the index stays in use
};

struct MapKeyframe {
  std::size_t frame = 0;
  Pose pose;  ///< camera_from_world
  Features features;
  std::vector<int> points;  ///< [features] -1: none
  std::vector<Color> colors;
  double median_depth = 1;
  std::size_t made_points = 0;  ///< number of points that it saw when created
  double scale = 1;             ///< factor by which loops changed lengths around it; 1 if the map is metric
};

/// A feature as a sighting, of no camera and point yet.
Sighting sighting_of(const Features& features, std::size_t feature);

class SparseMap {
 public:
  /// @param metric whether the scale of the map is known by depth; without it, the scale drifts
  explicit SparseMap(const Optics& optics, bool metric = true) : optics_(optics), metric_(metric) {}

  const Optics& optics() const { return optics_; }
  bool metric() const { return metric_; }
  std::vector<MapKeyframe>& keyframes() { return keyframes_; }
  const std::vector<MapKeyframe>& keyframes() const { return keyframes_; }
  std::vector<MapPoint>& points() { return points_; }
  const std::vector<MapPoint>& points() const { return points_; }
  MapPoint& point(int number) { return points_[static_cast<std::size_t>(number)]; }
  const MapPoint& point(int number) const { return points_[static_cast<std::size_t>(number)]; }

  /// Adds a point that a feature of a keyframe sees, at this distance. @return its index
  int add_point(const Vec3& position, double distance, std::size_t keyframe, std::size_t feature);
  void add_sighting(int point, std::size_t keyframe, std::size_t feature);
  void remove_sighting(int point, std::size_t keyframe);
  /// Moves the sightings of point `from` to `into` and removes `from`.
  void merge(int from, int into);
  /// Other keyframes that see points of `keyframe`, with the number of shared points; most first, ties by index.
  std::vector<std::pair<std::size_t, int>> covisible(std::size_t keyframe) const;
  /// Indices of the points that these keyframes see, ascending.
  std::vector<int> seen_by(std::span<const std::size_t> keyframes) const;

  Sighting sighting(std::size_t keyframe, std::size_t feature) const;

  /// Bundle adjustment of a keyframe, its neighbours and their points. Removes outlier sightings.
  void adjust_around(std::size_t keyframe);
  /// Bundle adjustment of the whole map.
  void adjust_all(int iterations);

 private:
  void adjust_these(std::span<const std::size_t> moving, std::span<const std::size_t> standing, int iterations);

  Optics optics_;
  bool metric_;
  std::vector<MapKeyframe> keyframes_;
  std::vector<MapPoint> points_;
};

/// Projects map points into an image and returns those inside it. @param radius search radius at the finest level, px
/// @param visible receives the indices of the returned points, in the same order
std::vector<Expected> expected_in(const SparseMap& map, const Pose& pose, std::span<const int> points, double radius,
                                  std::vector<int>& visible);

/// Computes a pose from matches of features with points by PnP with RANSAC, then refines it.
/// @param point_of_feature -1: none; outliers are set to -1
/// @param least minimum number of inliers @return whether there are enough
bool locate(const SparseMap& map, const Features& features, std::vector<int>& point_of_feature, Pose& pose,
            std::size_t least);

/// Refines a pose by all matches; outliers are set to -1. @return number of inliers
std::size_t refine(const SparseMap& map, const Features& features, std::vector<int>& point_of_feature, Pose& pose);

/// Keyframes of `among` whose features are most similar to these, at most `count`, the best first.
std::vector<std::size_t> similar_keyframes(const SparseMap& map, const Features& features,
                                           std::span<const std::size_t> among, std::size_t count);

}  // namespace splatboost::tracking

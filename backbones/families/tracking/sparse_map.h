// SPDX-License-Identifier: Apache-2.0
/// @file Keyframes and the points that they see.
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
  int level = 0;                                 ///< of the pyramid where it was found …
  double distance = 1;                           ///< … from so far away
  std::size_t keyframe = 0;                      ///< that it was made of
  std::map<std::size_t, std::size_t> sightings;  ///< keyframe → feature
  Color color{};
  int expected = 1, found = 1;  ///< frames in which it should have been seen, and was
  bool gone = false;
};

struct MapKeyframe {
  std::size_t frame = 0;
  Pose pose;  ///< camera_from_world
  Features features;
  std::vector<int> points;  ///< [features] -1: none
  std::vector<Color> colors;
  double median_depth = 1;
  std::size_t made_points = 0;  ///< it saw when it was made
};

class SparseMap {
 public:
  explicit SparseMap(const Optics& optics) : optics_(optics) {}

  const Optics& optics() const { return optics_; }
  std::vector<MapKeyframe>& keyframes() { return keyframes_; }
  const std::vector<MapKeyframe>& keyframes() const { return keyframes_; }
  std::vector<MapPoint>& points() { return points_; }
  const std::vector<MapPoint>& points() const { return points_; }
  MapPoint& point(int number) { return points_[static_cast<std::size_t>(number)]; }
  const MapPoint& point(int number) const { return points_[static_cast<std::size_t>(number)]; }

  void add_sighting(int point, std::size_t keyframe, std::size_t feature);
  void remove_sighting(int point, std::size_t keyframe);
  /// All that saw `from` sees `into`.
  void merge(int from, int into);
  /// Keyframe `keyframe` sees as many of the points that the others see; the most first, ties by number.
  std::vector<std::pair<std::size_t, int>> covisible(std::size_t keyframe) const;
  /// Points that these keyframes see, ascending.
  std::vector<int> seen_by(std::span<const std::size_t> keyframes) const;

  Sighting sighting(std::size_t keyframe, std::size_t feature) const;

  /// Bundle adjustment of a keyframe, its neighbours and their points. Sightings that do not fit go.
  void adjust_around(std::size_t keyframe);
  /// Of everything.
  void adjust_all(int iterations);

 private:
  void adjust_these(std::span<const std::size_t> moving, std::span<const std::size_t> standing, int iterations);

  Optics optics_;
  std::vector<MapKeyframe> keyframes_;
  std::vector<MapPoint> points_;
};

/// Where points of the map should be in a picture, those that can be. @param radius px at the finest level
/// @param visible gets the numbers of the points that are expected, in the same order
std::vector<Expected> expected_in(const SparseMap& map, const Pose& pose, std::span<const int> points, double radius,
                                  std::vector<int>& visible);

/// The pose from matches of points with features, by PnP and RANSAC, then refined; false: none fits enough of them.
/// @param point_of_feature -1: none; those that do not fit are cleared
bool locate(const SparseMap& map, const Features& features, std::vector<int>& point_of_feature, Pose& pose,
            std::size_t least);

/// Refines a pose by all matches; those that do not fit are cleared. @return how many are left
std::size_t refine(const SparseMap& map, const Features& features, std::vector<int>& point_of_feature, Pose& pose);

/// Keyframes that look most like these features, at most `count`, the best first.
std::vector<std::size_t> similar_keyframes(const SparseMap& map, const Features& features,
                                           std::span<const std::size_t> among, std::size_t count);

}  // namespace splatboost::tracking

// SPDX-License-Identifier: Apache-2.0
/// @file Poses and points from what cameras see, by Ceres: one pose, bundles, and graphs of poses.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "families/tracking/pose.h"

namespace splatboost::tracking {

/// A point as a camera saw it.
struct Sighting {
  std::size_t camera = 0;
  std::size_t point = 0;
  Vec2 pixel = Vec2::Zero();
  double depth = 0;  ///< along z; 0: not known
  double sigma = 1;  ///< standard deviation of the pixel
};

/// Errors are of pixel and inverse depth, each in standard deviations: a depth camera's error is even in disparity,
/// which is kDepthBaseline · fx / depth, and taken to be that of the pixel.
inline constexpr double kDepthBaseline = 0.08;  ///< metres

/// Squared error of a sighting in standard deviations; infinite behind the camera.
double squared_error(const Optics& optics, const Pose& pose, const Vec3& point, const Sighting& sighting);
/// What 95 % of right sightings stay below (chi-squared with 3 or 2 degrees of freedom).
inline double likely_error(const Sighting& sighting) { return sighting.depth > 0 ? 7.815 : 5.991; }

/// The pose from which known points look as they were seen; sightings that do not fit are found and left out.
/// @param sightings of any camera number; Sighting::point numbers `points`
/// @param fits [sightings] which do in the end
/// @return how many do
std::size_t refine_pose(const Optics& optics, std::span<const Vec3> points, std::span<const Sighting> sightings,
                        Pose& pose, std::vector<std::uint8_t>& fits);

struct Bundle {
  std::vector<Pose> poses;
  std::vector<std::uint8_t> fixed;  ///< [poses] which do not move; at least one
  std::vector<Vec3> points;
  std::vector<Sighting> sightings;
};

/// Minimises the robust sum of squared errors over poses and points.
void adjust(const Optics& optics, Bundle& bundle, int iterations);

/// A measured motion between two poses of a graph.
struct Edge {
  std::size_t from = 0, to = 0;
  Pose to_from;
  double weight = 1;  ///< of its error
};

/// Spreads what a loop is off over the poses. The first pose stays.
void relax_pose_graph(std::vector<Pose>& poses, std::span<const Edge> edges);

}  // namespace splatboost::tracking

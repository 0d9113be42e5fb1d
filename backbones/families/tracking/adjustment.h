// SPDX-License-Identifier: Apache-2.0
/// @file Least squares with Ceres: pose refinement, bundle adjustment and pose graphs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "families/tracking/pose.h"

namespace splatboost::tracking {

/// An observation of a point by a camera.
struct Sighting {
  std::size_t camera = 0;  ///< index of the pose
  std::size_t point = 0;   ///< index of the point
  Vec2 pixel = Vec2::Zero();
  double depth = 0;  ///< along z, metres; 0: unknown
  double sigma = 1;  ///< standard deviation of the pixel position, px
};

/// Residuals are of pixel position and inverse depth, each in standard deviations: a depth camera's error is uniform in
/// disparity, kDepthBaseline · fx / depth, and its standard deviation is taken to be that of the pixel position.
inline constexpr double kDepthBaseline = 0.08;  ///< metres

/// Squared residual of a sighting, in units of standard deviations; infinite behind the camera.
double squared_error(const Optics& optics, const Pose& pose, const Vec3& point, const Sighting& sighting);
/// Threshold of squared_error() for inliers: 95 % quantile of chi-squared with 3 or 2 degrees of freedom.
inline double likely_error(const Sighting& sighting) { return sighting.depth > 0 ? 7.815 : 5.991; }

/// The upper median of depths or of their ratios, of which there is at least one.
double median_of(std::vector<double> values);

/// Refines a pose by sightings of known points, rejecting outliers.
/// @param sightings Sighting::camera is ignored, Sighting::point is an index into `points`
/// @param fits [sightings] receives non-zero for inliers
/// @return number of inliers; 0 if it failed
std::size_t refine_pose(const Optics& optics, std::span<const Vec3> points, std::span<const Sighting> sightings,
                        Pose& pose, std::vector<std::uint8_t>& fits);

struct Bundle {
  std::vector<Pose> poses;
  std::vector<std::uint8_t> fixed;  ///< [poses] non-zero: constant; at least one must be
  std::vector<Vec3> points;
  std::vector<Sighting> sightings;
};

/// Bundle adjustment: minimises the robust (Huber) sum of squared errors over poses and points.
void adjust(const Optics& optics, Bundle& bundle, int iterations);

/// A measured relative pose between two nodes of a pose graph.
struct Edge {
  std::size_t from = 0, to = 0;
  Pose to_from;       ///< its translation is in the unit of length of `to`
  double weight = 1;  ///< factor of its residuals
  double scale = 1;   ///< unit of length of `from` in units of `to`
};

/// Optimises a pose graph, which distributes the error of a loop over its poses. The first pose is constant.
/// @param scales receives for each pose the factor by which lengths around it change, for a camera whose scale drifts;
/// null: lengths are known, Edge::scale is ignored
void relax_pose_graph(std::vector<Pose>& poses, std::span<const Edge> edges, std::vector<double>* scales = nullptr);

}  // namespace splatboost::tracking

// SPDX-License-Identifier: Apache-2.0
/// @file Positions of points from two views without depth: the first map of a single camera, and new points of its
/// keyframes.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "families/tracking/sparse_map.h"

namespace splatboost::tracking {

/// Positions of points that two cameras see, [in_first]; none where a point is behind a camera, does not fit its
/// sightings, or has too little parallax.
std::vector<std::optional<Vec3>> triangulate(const Optics& optics, const Pose& first, const Pose& second,
                                             std::span<const Sighting> in_first, std::span<const Sighting> in_second);

/// Two views of the same points. The first camera is at the origin; the unit of length is the median depth of the
/// points in it.
struct TwoViews {
  Pose second;
  std::vector<std::optional<Vec3>> points;  ///< [matches] none: an outlier
};

/// Relative pose of two cameras from matches. None if the matches do not determine it: too few fit, or a rotation
/// explains them.
std::optional<TwoViews> relate_views(const Optics& optics, std::span<const Sighting> in_first,
                                     std::span<const Sighting> in_second);

/// Matches features of a keyframe that are not map points with those of covisible keyframes, and adds what can be
/// triangulated to the map. @return indices of the added points
std::vector<int> add_triangulated_points(SparseMap& map, std::size_t keyframe);

}  // namespace splatboost::tracking

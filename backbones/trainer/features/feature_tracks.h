// SPDX-License-Identifier: Apache-2.0
/// @file Features of several views that show the same surface point, and that point.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <glm/vec3.hpp>

#include "splatboost/threads.h"
#include "trainer/features/view_features.h"

namespace splatboost {

struct Feature {
  std::size_t view = 0;    ///< index into the views
  std::size_t number = 0;  ///< index into ViewFeatures::pixels
};

struct TrackedPoint {
  glm::dvec3 position{0.0};       ///< world
  std::vector<Feature> features;  ///< that show it, of at least three different views
};

/// Pairs of views to match, ascending: each view with some of the nearest that look in a similar direction, and not
/// only with the very nearest, whose rays may be almost parallel.
std::vector<std::pair<std::size_t, std::size_t>> neighbouring_views(const std::vector<ViewFeatures>& views);

/// Matches features of these pairs of views along epipolar lines, connects them and triangulates. Features that do not
/// fit, such as of things that move, are left out. The result does not depend on the number of threads.
std::vector<TrackedPoint> track_points(const std::vector<ViewFeatures>& views,
                                       const std::vector<std::pair<std::size_t, std::size_t>>& pairs,
                                       const Threads& threads);

}  // namespace splatboost

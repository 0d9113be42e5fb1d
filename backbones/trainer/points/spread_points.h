// SPDX-License-Identifier: Apache-2.0
/// @file Points between triangulated ones.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "splatboost/threads.h"
#include "trainer/points/feature_tracks.h"
#include "trainer/points/view_features.h"

namespace splatboost {

struct SpreadPoint {
  glm::dvec3 position{0.0};  ///< world
  std::size_t view = 0;      ///< the view that it is taken from …
  glm::dvec2 pixel{0.0};     ///< … and where it is seen there, in pixels of ViewFeatures
};

/// Points on a regular grid of pixels of each view, outside masks. Each gets the depth of one of the tracked points
/// that are seen near it, the one at which the views around agree best on the grey values there, refined by a few per
/// cent.
/// @param pairs of views that see the same, of neighbouring_views()
/// @param count number of points, in all views together, if none is left out; approximate
std::vector<SpreadPoint> spread_points(const std::vector<ViewFeatures>& views, const std::vector<TrackedPoint>& tracked,
                                       const std::vector<std::pair<std::size_t, std::size_t>>& pairs, std::size_t count,
                                       const Threads& threads);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Additional interface of a backbone that trains while its views are still arriving.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <glm/mat4x4.hpp>

#include "trainer/dataset/scene.h"

namespace splatboost {

/// Points, each with the training view that saw it first.
struct SeenPoints {
  PointCloud points;                 ///< world
  std::vector<std::uint32_t> views;  ///< [N] indices of training views
};

/// A change of the map. Training views are numbered in order of arrival; the numbers never change.
struct MapChange {
  SeenPoints map_points;  ///< added to the map
  SeenPoints features;    ///< of the new views, those with depth, whether or not they are map points
  /// [views] motion of the world around each view when a loop was closed: new ← old, a similarity: where the scale is
  /// not known, it is corrected too. Empty: no loop was closed.
  std::vector<glm::dmat4> corrections;
};

/// A Backbone may implement this too. The owner of the scene appends and moves its training views between two
/// iterations of the backbone; they are also the backbone's scorable views, the newest last.
class OnlineBackbone {
 public:
  virtual ~OnlineBackbone() = default;
  /// Call after the scene has changed, and once with an empty change before the first iteration.
  virtual void map_changed(const MapChange& change) = 0;
  /// The view that the iteration trains on; valid until the next call.
  virtual const View& next_view(int iteration) = 0;
  /// No more views will arrive. @param iterations length of the whole run, replacing the planned one
  virtual void views_complete(int iterations) = 0;
  /// The length of the run as far as it is known at `iteration`.
  virtual int planned_iterations(int iteration) const = 0;
};

}  // namespace splatboost

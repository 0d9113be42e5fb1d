// SPDX-License-Identifier: Apache-2.0
/// @file What a backbone offers besides Backbone that trains while its views are still coming in.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <glm/mat4x4.hpp>

#include "trainer/dataset/scene.h"

namespace splatboost {

/// Points with the training view that each was seen from first.
struct SeenPoints {
  PointCloud points;                 ///< world
  std::vector<std::uint32_t> views;  ///< [N] numbers of training views
};

/// What is new on a map. Training views are numbered in the order in which they came, for good.
struct MapChange {
  SeenPoints map_points;  ///< new on the map
  SeenPoints features;    ///< of new views, with depth, whether on the map or not
  /// [views] how a loop that was closed moved the world around each view: new ← old. Empty: no loop was closed.
  std::vector<glm::dmat4> corrections;
};

/// A Backbone may be one too. Its scene's training views are appended to and moved by whoever owns the scene, between
/// two of its iterations; they are its scorable views, the newest last.
class OnlineBackbone {
 public:
  virtual ~OnlineBackbone() = default;
  /// The scene has changed. Also to be called, with nothing new, before the first iteration.
  virtual void map_changed(const MapChange& change) = 0;
  /// What the iteration trains on; lives until the next call.
  virtual const View& next_view(int iteration) = 0;
  /// No more views come. @param iterations of the whole run, from now on
  virtual void views_complete(int iterations) = 0;
  /// The length of the run, as far as it is known.
  virtual int planned_iterations(int iteration) const = 0;
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Levels of detail: which level a distance asks for, and which level is open when.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "octree_gs/octree_levels_math.h"
#include "splatboost/camera.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

LevelRounding level_rounding_named(std::string_view name);

/// Distances of a scene, and the number of levels that they ask for.
struct LevelRange {
  float standard_distance = 1;  ///< at which level 0 is asked for; half of it asks for level 1 where fork is 2
  int levels = 1;
};

/// From the distances of all points to all cameras: their `ratio` and 1 − `ratio` quantiles in each view, then over
/// views.
LevelRange measure_levels(std::span<const float> points, const std::vector<View>& views, double ratio, int fork);

/// Iterations at which one more level opens: `count` of them, each interval 1/factor of the one before, the last at
/// `end`.
std::vector<double> opening_iterations(int count, double end, double factor);

}  // namespace splatboost

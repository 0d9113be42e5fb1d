// SPDX-License-Identifier: Apache-2.0
/// @file Levels of detail: range of a scene's levels, and when levels are enabled.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "octree_gs/octree_levels_math.h"
#include "splatboost/camera.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

LevelRounding level_rounding_named(std::string_view name);

/// Reference distance and number of levels of a scene.
struct LevelRange {
  float standard_distance = 1;  ///< needs level 0; half of it needs level 1 if fork is 2
  int levels = 1;
};

/// Computed from the distances of all points to all cameras: the `ratio` and 1 − `ratio` quantiles in each view, then
/// the quantiles of these over views.
LevelRange measure_levels(std::span<const float> points, const std::vector<View>& views, double ratio, int fork);

/// The `count` iterations at which a further level is enabled: each interval is 1/factor of the one before, the last
/// iteration is `end`.
std::vector<double> opening_iterations(int count, double end, double factor);

}  // namespace splatboost

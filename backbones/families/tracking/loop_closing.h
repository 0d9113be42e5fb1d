// SPDX-License-Identifier: Apache-2.0
/// @file A camera that is back where it was: found by what it sees, checked by geometry, and put right.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "families/tracking/sparse_map.h"

namespace splatboost::tracking {

struct Loop {
  std::size_t keyframe = 0;           ///< that came back …
  std::size_t earlier = 0;            ///< … to what this one saw
  Pose pose;                          ///< of `keyframe` by the points of that time
  std::vector<int> point_of_feature;  ///< of `keyframe`: those points
};

/// Looks for a place among the keyframes that see nothing of what `keyframe` and its neighbours see.
std::optional<Loop> find_loop(const SparseMap& map, std::size_t keyframe);

/// Spreads what the loop is off over the keyframes between, joins what was mapped twice, and adjusts everything.
void close_loop(SparseMap& map, const Loop& loop);

}  // namespace splatboost::tracking

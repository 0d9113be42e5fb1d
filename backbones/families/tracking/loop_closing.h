// SPDX-License-Identifier: Apache-2.0
/// @file Loop closing: detection by appearance, geometric verification and correction of the map.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "families/tracking/sparse_map.h"

namespace splatboost::tracking {

struct Loop {
  std::size_t keyframe = 0;           ///< the keyframe that returned to a known place
  std::size_t earlier = 0;            ///< the keyframe that saw this place before
  Pose pose;                          ///< of `keyframe` relative to the earlier points
  double scale = 1;                   ///< lengths of the earlier points / of the newer ones; 1 if the map is metric
  std::vector<int> point_of_feature;  ///< of `keyframe`: index of the earlier point, or -1
};

/// Searches for a loop among the keyframes that are not covisible with `keyframe` and its neighbours.
std::optional<Loop> find_loop(const SparseMap& map, std::size_t keyframe);

/// Distributes the error of the loop over the keyframes, merges duplicate points and runs a full bundle adjustment.
/// If the map is not metric, it also distributes the drift of the scale and changes MapKeyframe::scale.
void close_loop(SparseMap& map, const Loop& loop);

}  // namespace splatboost::tracking

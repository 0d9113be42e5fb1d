// SPDX-License-Identifier: Apache-2.0
/// @file Level of detail for a distance, shared by all devices.
#pragma once

#include <algorithm>
#include <cmath>

#include "families/nets/shared_math.h"

namespace splatboost {

/// Rounding of a real level to an integer.
enum class LevelRounding { round, floor, ceil };

/// Real level for a distance: log(standard / distance) / log(fork).
SPLATBOOST_SHARED_MATH float level_at(float distance, float standard_distance, float fork) {
  return std::log2(standard_distance / distance) / std::log2(fork);
}

/// Rounds a level and clamps it to [0, highest].
SPLATBOOST_SHARED_MATH int whole_level(float level, LevelRounding rounding, int highest) {
  const float whole = rounding == LevelRounding::round   ? std::nearbyint(level)
                      : rounding == LevelRounding::floor ? std::floor(level)
                                                         : std::ceil(level);
  return static_cast<int>(std::clamp(whole, 0.0f, static_cast<float>(highest)));
}

}  // namespace splatboost

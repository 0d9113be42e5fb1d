// SPDX-License-Identifier: Apache-2.0
/// @file Which level of detail a distance asks for, on every device.
#pragma once

#include <algorithm>
#include <cmath>

#include "families/nets/shared_math.h"

namespace splatboost {

/// How a real level becomes a whole one.
enum class LevelRounding { round, floor, ceil };

/// Level that a distance asks for: log(standard / distance) / log(fork), real.
SPLATBOOST_SHARED_MATH float level_at(float distance, float standard_distance, float fork) {
  return std::log2(standard_distance / distance) / std::log2(fork);
}

/// Whole and within [0, highest].
SPLATBOOST_SHARED_MATH int whole_level(float level, LevelRounding rounding, int highest) {
  const float whole = rounding == LevelRounding::round   ? std::nearbyint(level)
                      : rounding == LevelRounding::floor ? std::floor(level)
                                                         : std::ceil(level);
  return static_cast<int>(std::clamp(whole, 0.0f, static_cast<float>(highest)));
}

}  // namespace splatboost

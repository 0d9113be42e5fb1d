// SPDX-License-Identifier: Apache-2.0
/// @file Selection of the anchors that a view may use: those whose level is needed at their distance.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "octree_gs/octree_levels_math.h"
#include "splatboost/device.h"

namespace splatboost {

inline constexpr int kMaxLevels = 24;

/// Selection rule of one view.
struct LevelsInUse {
  std::array<float, 3> centre{};  ///< of the camera, world space
  float standard_distance = 1;
  float fork = 2;
  LevelRounding rounding = LevelRounding::round;
  int highest = 0;                        ///< finest enabled level
  std::array<float, kMaxLevels> shift{};  ///< [level] half the cell size, added to each coordinate of an anchor
};

/// Whether the view may use an anchor. @param position [3]
SPLATBOOST_SHARED_MATH bool is_usable(const LevelsInUse& rule, const float* position, float level, float extra_level) {
  const float shift = rule.shift[static_cast<std::size_t>(level)];
  const float x = position[0] + shift - rule.centre[0], y = position[1] + shift - rule.centre[1],
              z = position[2] + shift - rule.centre[2];
  const float wanted = level_at(std::sqrt(x * x + y * y + z * z), rule.standard_distance, rule.fork) + extra_level;
  return static_cast<int>(level) <= whole_level(wanted, rule.rounding, rule.highest);
}

/// @param positions [N,3] @param levels [N] @param extra_levels [N] added to the level needed at the distance
/// @param usable [N] 1 or 0
void usable_anchors(const LevelsInUse& rule, std::span<const float> positions, std::span<const float> levels,
                    std::span<const float> extra_levels, std::span<std::uint8_t> usable, Device device);

namespace cuda {
void usable_anchors(const LevelsInUse& rule, std::span<const float> positions, std::span<const float> levels,
                    std::span<const float> extra_levels, std::span<std::uint8_t> usable, CudaStream& stream);
}  // namespace cuda

}  // namespace splatboost

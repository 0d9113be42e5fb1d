// SPDX-License-Identifier: Apache-2.0
/// @file Morton code of a point.
#pragma once

#include <cstdint>

#include "device/host_device.h"

namespace splatboost {

inline constexpr double kMortonCells = 1 << 21;  // per axis: outliers must not collapse the other points into one cell
inline constexpr std::uint64_t kMortonLast = ~std::uint64_t{0};  ///< code of points that are not finite

/// Spreads the lowest 21 bits to every third bit.
SPLATBOOST_HOST_DEVICE std::uint64_t spread_bits(std::uint64_t bits) {
  bits &= 0x1fffff;
  bits = (bits | bits << 32) & 0x1f00000000ffff;
  bits = (bits | bits << 16) & 0x1f0000ff0000ff;
  bits = (bits | bits << 8) & 0x100f00f00f00f00f;
  bits = (bits | bits << 4) & 0x10c30c30c30c30c3;
  return (bits | bits << 2) & 0x1249249249249249;
}

/// @param low lowest corner of the bounding box of all points @param extent its longest side, so that cells are cubes
SPLATBOOST_HOST_DEVICE std::uint64_t morton_code(const float* point, const float* low, double extent) {
  std::uint64_t code = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto value = static_cast<double>(point[axis]);
    if (!(value - value == 0)) return kMortonLast;
    const double cell = extent > 0 ? (value - static_cast<double>(low[axis])) / extent * kMortonCells : 0.0;
    const double last = kMortonCells - 1;
    code |= spread_bits(static_cast<std::uint64_t>(cell < last ? cell : last)) << axis;
  }
  return code;
}

}  // namespace splatboost

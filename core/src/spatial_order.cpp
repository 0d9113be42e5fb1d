// SPDX-License-Identifier: Apache-2.0
#include "splatboost/spatial_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "splatboost/errors.h"

namespace splatboost {
namespace {

constexpr double kCells = 1 << 21;  // an axis: so fine that far-off points do not throw the others into one cell

/// Spreads 21 bits three apart.
std::uint64_t spread(std::uint64_t bits) {
  bits &= 0x1fffff;
  bits = (bits | bits << 32) & 0x1f00000000ffff;
  bits = (bits | bits << 16) & 0x1f0000ff0000ff;
  bits = (bits | bits << 8) & 0x100f00f00f00f00f;
  bits = (bits | bits << 4) & 0x10c30c30c30c30c3;
  return (bits | bits << 2) & 0x1249249249249249;
}

}  // namespace

void spatial_order(std::span<const float> means, std::span<std::uint32_t> order) {
  const std::size_t n = order.size();
  SPLATBOOST_CHECK(means.size() == 3 * n, "means must be [N,3] where order is [N]");
  std::array<float, 3> low, high;
  low.fill(std::numeric_limits<float>::max());
  high.fill(std::numeric_limits<float>::lowest());
  for (std::size_t i = 0; i < 3 * n; ++i) {
    if (!std::isfinite(means[i])) continue;
    low[i % 3] = std::min(low[i % 3], means[i]);
    high[i % 3] = std::max(high[i % 3], means[i]);
  }
  double extent = 0;  // the same for all axes: cells are cubes
  for (std::size_t axis = 0; axis < 3; ++axis) {
    extent = std::max(extent, static_cast<double>(high[axis]) - static_cast<double>(low[axis]));
  }
  std::vector<std::pair<std::uint64_t, std::uint32_t>> codes(n);
  for (std::size_t i = 0; i < n; ++i) {
    std::uint64_t code = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto value = static_cast<double>(means[3 * i + axis]);
      if (!std::isfinite(value)) {
        code = std::numeric_limits<std::uint64_t>::max();
        break;
      }
      const double cell = extent > 0 ? (value - static_cast<double>(low[axis])) / extent * kCells : 0.0;
      code |= spread(static_cast<std::uint64_t>(std::min(cell, kCells - 1))) << axis;
    }
    codes[i] = {code, static_cast<std::uint32_t>(i)};
  }
  std::sort(codes.begin(), codes.end());
  for (std::size_t i = 0; i < n; ++i) order[i] = codes[i].second;
}

}  // namespace splatboost

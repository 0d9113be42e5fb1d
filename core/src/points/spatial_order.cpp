// SPDX-License-Identifier: Apache-2.0
#include "splatboost/spatial_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "points/cuda_ops.h"
#include "points/spatial_order_math.h"
#include "splatboost/errors.h"

namespace splatboost {

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
    codes[i] = {morton_code(means.data() + 3 * i, low.data(), extent), static_cast<std::uint32_t>(i)};
  }
  std::sort(codes.begin(), codes.end());
  for (std::size_t i = 0; i < n; ++i) order[i] = codes[i].second;
}

void spatial_order(std::span<const float> means, std::span<std::uint32_t> order, Device device) {
  if (!device.is_cuda()) return spatial_order(means, order);
  SPLATBOOST_CHECK(means.size() == 3 * order.size(), "means must be [N,3] where order is [N]");
  cuda::spatial_order(means, order, device.stream());
}

}  // namespace splatboost

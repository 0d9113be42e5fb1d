// SPDX-License-Identifier: Apache-2.0
/// @file An order of points in which neighbours in space are mostly neighbours in memory.
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/device.h"

namespace splatboost {

/// Order along a Morton curve over the points' bounding box, ties by index. In this order the Gaussians of a tile are
/// close in memory and hit the cache; rendered results depend on the order only through rounding.
/// @param means [N,3]; points that are not finite come last
/// @param order [N] receives the index of the point at each place
void spatial_order(std::span<const float> means, std::span<std::uint32_t> order);
/// The same order in the memory of a device.
void spatial_order(std::span<const float> means, std::span<std::uint32_t> order, Device device);

}  // namespace splatboost

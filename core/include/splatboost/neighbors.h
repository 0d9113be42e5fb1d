// SPDX-License-Identifier: Apache-2.0
/// @file Distances to the nearest neighbours of points: the initial scales of Gaussians.
#pragma once

#include <span>

#include "splatboost/device.h"

namespace splatboost {

/// Mean squared distance of each point to its k nearest others (3DGS: k = 3); with fewer than k others, to all of
/// them, and 0 for a single point. Coincident points count as neighbours at distance 0. Points must be finite.
/// On a CUDA device k is at most 8.
/// @param points [N,3]
/// @param mean_squared_distances [N]
void mean_squared_neighbor_distances(std::span<const float> points, int k, std::span<float> mean_squared_distances,
                                     Device device);

}  // namespace splatboost

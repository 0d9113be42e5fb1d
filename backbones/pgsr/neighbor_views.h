// SPDX-License-Identifier: Apache-2.0
/// @file Selection of training views that see the same surfaces as another.
#pragma once

#include <cstddef>
#include <vector>

#include "splatboost/random.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

struct NeighborLimits {
  int most = 8;                           ///< neighbours per view
  double angle = 30;                      ///< upper limit of the angle between view directions, degrees
  double nearest = 0.01, farthest = 1.5;  ///< limits of the distance between centres, world units
};

/// Neighbours of each view, sorted by distance, then angle, then index.
std::vector<std::vector<std::size_t>> neighbor_views(const std::vector<View>& views, const NeighborLimits& limits);

/// A random view without a photo, near another.
/// @param shift maximum translation along each axis, world units
/// @param turn maximum rotation about each axis, degrees
View virtual_view(const View& near, double shift, double turn, const RandomStream& random);

}  // namespace splatboost

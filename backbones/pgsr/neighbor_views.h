// SPDX-License-Identifier: Apache-2.0
/// @file Which training views see the same surfaces as another.
#pragma once

#include <cstddef>
#include <vector>

#include "splatboost/random.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

struct NeighborLimits {
  int most = 8;
  double angle = 30;                      ///< degrees between view directions; neighbours are below it
  double nearest = 0.01, farthest = 1.5;  ///< between centres, world units; neighbours lie between
};

/// Of each view its neighbours, by distance, then by angle, then by number.
std::vector<std::vector<std::size_t>> neighbor_views(const std::vector<View>& views, const NeighborLimits& limits);

/// How far views stand from what they see: the median over views of the median depth of the points in them. 1 if there
/// are none.
double typical_depth(const Scene& scene);

/// A view without a photo, near another.
/// @param shift most along each axis, world units
/// @param turn most about each axis, degrees
View virtual_view(const View& near, double shift, double turn, const RandomStream& random);

}  // namespace splatboost

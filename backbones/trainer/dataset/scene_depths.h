// SPDX-License-Identifier: Apache-2.0
/// @file How far from the cameras the points of a scene are.
#pragma once

#include <cstddef>
#include <vector>

#include "trainer/dataset/scene.h"

namespace splatboost {

/// Depths above 0 of the points in the camera's picture, world units, in their order.
/// @param every of so many points one is looked at; at least 1
std::vector<float> depths_in_view(const Camera& camera, const PointCloud& points, std::size_t every);

/// The median over views of the median depth of the scene's points in them, world units. 1 if there are none.
double typical_depth(const Scene& scene);

/// The share of the scene's points in the views that have a depth below this one, world units. 0 if there are none.
double share_nearer(const Scene& scene, double depth);

}  // namespace splatboost

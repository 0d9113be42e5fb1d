// SPDX-License-Identifier: Apache-2.0
/// @file The distance from which a scene was photographed, for settings of backbones that are in its units.
#pragma once

#include "trainer/dataset/scene.h"

namespace splatboost {

/// The median over views of the median depth of the scene's points in them, world units. 1 if there are none.
double typical_depth(const Scene& scene);

/// The share of the scene's points in the views that have a depth below this one, world units. 0 if there are none.
double share_nearer(const Scene& scene, double depth);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file A camera path around what the training cameras look at.
#pragma once

#include <vector>

#include "splatboost/camera.h"
#include "trainer/dataset/scene.h"

namespace splatboost::program {

/// `count` cameras on a circle at the training cameras' mean distance and height, or, if these stand on one side of the
/// scene only, back and forth on the arc that they cover. Image size and focal lengths are those of the first training
/// camera.
std::vector<Camera> orbit_cameras(const Scene& scene, int count);

}  // namespace splatboost::program

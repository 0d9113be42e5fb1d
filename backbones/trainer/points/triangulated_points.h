// SPDX-License-Identifier: Apache-2.0
/// @file Initial points from photos with known poses, for datasets that have no points.
#pragma once

#include <vector>

#include "splatboost/threads.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

/// Points on surfaces, in world units, with their colours: features that at least three of the views show are
/// triangulated (feature_tracks.h), and pixels near them get similar depths (spread_points.h), because a few hundred
/// features of small photos are too few to start from. The result does not depend on the number of threads.
/// @return none if fewer than 100 points can be triangulated, as of views with little texture or overlap and in a build
/// without OpenCV
PointCloud triangulate_points(const std::vector<View>& views, const Threads& threads);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Initial points from photos with known poses: for datasets that have none, or none in parts of the scene.
#pragma once

#include <vector>

#include "splatboost/threads.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

/// Points on surfaces, in world units, with their colours: features that at least three of the views show are
/// triangulated (feature_tracks.h), and where views show none of these points and of `known`, they get one
/// (gap_points.h). The result does not depend on the number of threads.
/// @param known the points that the dataset has; may be empty
/// @return the points to add to `known`. None if there are fewer than 100 in all before gaps are filled, as of views
/// with little texture or overlap, and in a build without OpenCV
PointCloud triangulate_points(const std::vector<View>& views, const PointCloud& known, const Threads& threads);

}  // namespace splatboost

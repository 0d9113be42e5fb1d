// SPDX-License-Identifier: Apache-2.0
/// @file Initial points from photos with known poses: for datasets that have none, or none in parts of the scene.
#pragma once

#include "splatboost/threads.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

/// Points on surfaces, in world units, with their colours: features that at least three training views show
/// (feature_tracks.h). The result does not depend on the number of threads.
/// @return the points to add to Scene::points, which may be empty. None if there are fewer than 100 with these, as of
/// views with little texture or overlap. A build without OpenCV finds no features
PointCloud triangulate_features(const Scene& scene, const Threads& threads);

/// These points, and one on a surface wherever views show none of them and of the scene's (gap_points.h). Empty
/// likewise.
PointCloud triangulate_surfaces(const Scene& scene, const Threads& threads);

/// These points, and one behind the scene where views show none of them and of the scene's (backdrop_points.h). Empty
/// likewise.
PointCloud triangulate_points(const Scene& scene, const Threads& threads);

/// Whether triangulate_points() may add to the points of the scene: not if it moves, if its points were triangulated,
/// or if they are random, as those of rendered scenes.
bool may_add_points(const Scene& scene);

}  // namespace splatboost

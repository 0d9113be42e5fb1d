// SPDX-License-Identifier: Apache-2.0
/// @file Points far behind the scene, where the photos show something but no point is near.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <glm/vec3.hpp>

#include "splatboost/threads.h"
#include "trainer/features/view_features.h"
#include "trainer/points/gap_points.h"

namespace splatboost {

/// Goes through the pixels of a regular grid in each view that need points (points_in_picture.h). Where none of the
/// known points and of these is seen within `spacing`, it adds one on a sphere around all cameras and nearly all known
/// points, unless another view shows the background there. Without such points, a wall without texture, the sky or the
/// backdrop of a studio is learned from Gaussians that float between the cameras and the scene. None if all cameras and
/// points are at one place. The result does not depend on the number of threads.
/// @param known points that are there, world; each is taken to be seen in all views in front of which it is
/// @param spacing of the grid, × diagonal of the picture
/// @param background grey value of what renders show where there is no Gaussian
std::vector<GapPoint> backdrop_points(const std::vector<ViewFeatures>& views, std::span<const glm::dvec3> known,
                                      double spacing, std::uint8_t background, const Threads& threads);

}  // namespace splatboost

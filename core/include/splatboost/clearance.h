// SPDX-License-Identifier: Apache-2.0
/// @file The space around the cameras, which is empty: Gaussians there are floaters. Not in the paper.
#pragma once

#include <span>

#include "splatboost/device.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Whether points [M,3] fill their bounding box evenly, as if drawn at random there, as for a scene without points.
/// False if fewer than 512 are finite, too few to tell.
bool points_are_random(std::span<const float> points);

/// Whether points [M,3] show where surfaces are: not if they are random, nor if fewer than 64 are finite.
bool points_show_surfaces(std::span<const float> points);

/// Distances of cameras to the scene: to its nearest points, in any direction. Some points may be wrong, so max(10,
/// M / max(1000, 10·C)) may be nearer: with many cameras a tenth of one camera's share, because in a long scene the
/// surfaces around a camera are a small share of all points.
/// @param centres [C,3] of all training cameras, world frame
/// @param points [M,3] of the scene before training, such as those of structure from motion
/// @param distances [C] world units; all are 0 unless points_show_surfaces()
void distances_to_scene(std::span<const float> centres, std::span<const float> points, std::span<float> distances,
                        const Threads& threads);

/// Clearances of Gaussians: clearances[i] = min_c |means_i − centres_c| / distances_c. Below 1, a Gaussian is nearer to
/// a camera than the scene is.
/// @param means [N,3]
/// @param centres [C,3]
/// @param distances [C] of distances_to_scene(); cameras at distance 0 are left out
/// @param clearances [N] infinite if no camera is left
void camera_clearances(std::span<const float> means, std::span<const float> centres, std::span<const float> distances,
                       std::span<float> clearances, Device device);

}  // namespace splatboost

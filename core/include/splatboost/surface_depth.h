// SPDX-License-Identifier: Apache-2.0
/// @file Depth and normals of the surface that a view shows, from planes blended over it (gaussian_planes.h).
#pragma once

#include <span>

#include "splatboost/camera.h"
#include "splatboost/device.h"

namespace splatboost {

/// Depth along z, where the ray of a pixel meets the blended plane: D / −(N·ray), ray = ((x − cx)/fx, (y − cy)/fy, 1)
/// at the pixel's centre. Sums need not be normalised, alpha cancels (PGSR's unbiased depth). 0 where the blended
/// normal does not face the camera, as in pixels that show nothing.
/// @param planes [4,H,W] blended normals and distances
/// @param depth [H,W]
void plane_depth(const Camera& camera, std::span<const float> planes, std::span<float> depth, Device device);

/// Adds to the gradients of the planes.
/// @param depth_gradients [H,W]
/// @param plane_gradients [4,H,W]
void plane_depth_backward(const Camera& camera, std::span<const float> planes, std::span<const float> depth_gradients,
                          std::span<float> plane_gradients, Device device);

/// Unit normals in the camera frame, towards the camera, of the surface through a pixel's four neighbours; 0 on the
/// border, and where a neighbour has no depth.
/// @param depth [H,W]
/// @param normals [3,H,W]
void depth_normals(const Camera& camera, std::span<const float> depth, std::span<float> normals, Device device);

}  // namespace splatboost

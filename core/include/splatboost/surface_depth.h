// SPDX-License-Identifier: Apache-2.0
/// @file Depth and normals of the visible surface, from alpha-blended planes (gaussian_planes.h).
#pragma once

#include <span>

#include "splatboost/camera.h"
#include "splatboost/device.h"

namespace splatboost {

/// Depth along z where the ray of a pixel meets the blended plane: D / −(N·ray), ray = ((x − cx)/fx, (y − cy)/fy, 1)
/// at the pixel's centre. The sums need not be normalised, because alpha cancels (PGSR's unbiased depth). The depth is
/// 0 where the blended normal N does not face the camera, for example in empty pixels.
/// @param planes [4,H,W] blended normals N and distances D
/// @param depth [H,W] receives the depth, world units
void plane_depth(const Camera& camera, std::span<const float> planes, std::span<float> depth, Device device);

/// Adds the gradients with respect to the planes.
/// @param depth_gradients [H,W]
/// @param plane_gradients [4,H,W]
void plane_depth_backward(const Camera& camera, std::span<const float> planes, std::span<const float> depth_gradients,
                          std::span<float> plane_gradients, Device device);

/// Unit normals of the surface through the four neighbours of each pixel, in the camera frame, towards the camera; 0 on
/// the border and where a neighbour has no depth.
/// @param depth [H,W]
/// @param normals [3,H,W]
void depth_normals(const Camera& camera, std::span<const float> depth, std::span<float> normals, Device device);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Gaussians as planes (PGSR, Chen et al. 2024, Sec. 3.1): a flat Gaussian lies in the plane normal to its
/// shortest axis. Alpha blending the normals and distances of these planes, like colours, gives the surface of a view
/// (surface_depth.h).
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/device.h"
#include "splatboost/gaussians.h"

namespace splatboost {

/// Channels of a plane: its normal in the camera frame, and its distance from the camera.
inline constexpr int kPlaneChannels = 4;

/// The normal is the axis of the smallest scale (the first of equal ones), oriented towards the camera; the distance is
/// from the camera's centre to the plane through the mean, so that n·x + distance = 0 in the camera frame.
/// @param gaussians means, scales and rotations are read
/// @param planes [N,4]
void gaussian_planes(const Gaussians& gaussians, const Camera& camera, std::span<float> planes, Device device);

/// Adds the gradients with respect to means and rotations.
/// @param plane_gradients [N,4]
/// @param means [N,3]
/// @param rotations [N,4] with respect to the stored quaternions, which need not be normalised
void gaussian_planes_backward(const Gaussians& gaussians, const Camera& camera, std::span<const float> plane_gradients,
                              std::span<float> means, std::span<float> rotations, Device device);

/// A loss that flattens Gaussians: weight × the mean of the smallest scale over visible Gaussians.
/// @param scales [N,3]
/// @param visible [N]
/// @param sums [2] in device memory: the loss, and the number of visible Gaussians
void flatness_loss(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                   std::span<double> sums, Device device);

/// Adds the gradients of flatness_loss().
/// @param sums as flatness_loss() left them
/// @param gradients [N,3]; of equal scales only the first gets a gradient
void flatness_loss_backward(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                            std::span<const double> sums, std::span<float> gradients, Device device);

}  // namespace splatboost

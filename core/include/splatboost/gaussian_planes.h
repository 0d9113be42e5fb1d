// SPDX-License-Identifier: Apache-2.0
/// @file Gaussians as planes (PGSR, Chen et al. 2024, Sec. 3.1): a flat Gaussian lies in the plane that is normal to
/// its shortest axis. Blended like colours, normals and distances of planes give the surface of a view
/// (surface_depth.h).
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/device.h"
#include "splatboost/gaussians.h"

namespace splatboost {

/// Numbers of a plane: its normal in the camera frame, and the camera's distance from it.
inline constexpr int kPlaneChannels = 4;

/// The normal is the axis of the smallest scale (of equal ones the first), turned towards the camera; the distance is
/// that of the camera's centre to the plane through the mean, so that n·x + distance = 0 in the camera frame.
/// @param gaussians their means, scales and rotations
/// @param planes [N,4]
void gaussian_planes(const Gaussians& gaussians, const Camera& camera, std::span<float> planes, Device device);

/// Adds to the gradients of means and rotations.
/// @param plane_gradients [N,4]
/// @param means [N,3]
/// @param rotations [N,4] of quaternions as they are stored, of any length
void gaussian_planes_backward(const Gaussians& gaussians, const Camera& camera, std::span<const float> plane_gradients,
                              std::span<float> means, std::span<float> rotations, Device device);

/// Flatness, a loss that makes Gaussians flat: weight × the mean, over those that are visible, of the smallest scale.
/// @param scales [N,3]
/// @param visible [N]
/// @param sums two numbers of the device: the loss, and how many are visible
void flatness_loss(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                   std::span<double> sums, Device device);

/// Adds its gradients.
/// @param sums as flatness_loss() left them
/// @param gradients [N,3]; of equal scales the first gets it
void flatness_loss_backward(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                            std::span<const double> sums, std::span<float> gradients, Device device);

}  // namespace splatboost

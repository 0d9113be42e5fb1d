// SPDX-License-Identifier: Apache-2.0
/// @file Finds the Gaussians that a view can see, without rendering it.
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/device.h"
#include "splatboost/gaussians.h"
#include "splatboost/rasterizer.h"

namespace splatboost {

/// 1 if a mean lies beyond the near plane, else 0. The sides of the view frustum are not tested (3DGS: markVisible).
/// @param means [N,3] world
/// @param visible [N]
void mark_visible(const Camera& camera, std::span<const float> means, float near_plane, std::span<std::uint8_t> visible,
                  Device device);

/// Radius in px, rounded up, of each 3σ square that meets a tile of the image; 0 for the others. Equals
/// Rasterizer::screen_radii() after rendering with BoxPolicy::square, but needs neither opacities nor colours
/// (Scaffold-GS: visible_filter).
/// @param gaussians only means, and scales with rotations or covariances, are read
/// @param options only low_pass and near_plane are read
/// @param radii [N]
void visible_radii(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
                   std::span<std::int32_t> radii, Device device);

}  // namespace splatboost

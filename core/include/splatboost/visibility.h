// SPDX-License-Identifier: Apache-2.0
/// @file Which Gaussians a view can see, without drawing it.
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/device.h"
#include "splatboost/gaussians.h"
#include "splatboost/rasterizer.h"

namespace splatboost {

/// 1 where a mean lies beyond the near plane, else 0; the sides of the view do not matter (3DGS: markVisible).
/// @param means [N,3] world
/// @param visible [N]
void mark_visible(const Camera& camera, std::span<const float> means, float near_plane, std::span<std::uint8_t> visible,
                  Device device);

/// Radii in px of the 3σ squares that meet a tile of the image, rounded up; 0 elsewhere. What Rasterizer::screen_radii
/// holds after drawing with BoxPolicy::square, but without opacities and colours (Scaffold-GS: visible_filter).
/// @param gaussians means, and scales with rotations or covariances, are read; shapes must fit
/// @param options low_pass and near_plane are read
/// @param radii [N]
void visible_radii(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
                   std::span<std::int32_t> radii, Device device);

}  // namespace splatboost

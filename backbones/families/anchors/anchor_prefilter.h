// SPDX-License-Identifier: Apache-2.0
/// @file Culling of anchors: a view decodes those whose own ellipsoid's 3σ square overlaps a tile.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "splatboost/camera.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Replaces the contents of `visible` by the anchors in view, ascending. An anchor has no opacity, so this uses the 3σ
/// square of 3DGS whatever box the Gaussians are rendered with. Not differentiated.
/// @param positions [N,3]
/// @param scales [N,6]; 0..2 are the standard deviations along the world axes
/// @param candidates [N] zero: ignore this anchor; empty: consider all
/// @param mask [N] workspace; afterwards non-zero where in view
void anchors_in_view(const Camera& camera, std::span<const float> positions, std::span<const float> scales,
                     std::span<const std::uint8_t> candidates, const Threads& threads, std::vector<std::uint8_t>& mask,
                     std::vector<std::uint32_t>& visible);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Which anchors a view decodes at all: those whose own ellipsoid's 3σ square meets a tile.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "splatboost/camera.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Appends the anchors in view, ascending, to `visible` after clearing it. An anchor has no opacity, so this stays the
/// 3σ square of 3DGS whatever box the Gaussians are drawn with. It passes no gradient.
/// @param positions [N,3]
/// @param scales [N,6] of which 0..2 are the standard deviations along the world's axes
/// @param candidates [N] zero: not to be considered; empty: all are
/// @param mask [N] workspace, non-zero where in view afterwards
void anchors_in_view(const Camera& camera, std::span<const float> positions, std::span<const float> scales,
                     std::span<const std::uint8_t> candidates, Threads& threads, std::vector<std::uint8_t>& mask,
                     std::vector<std::uint32_t>& visible);

}  // namespace splatboost

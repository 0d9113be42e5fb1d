// SPDX-License-Identifier: Apache-2.0
/// @file Points where views show none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "splatboost/threads.h"
#include "trainer/features/view_features.h"

namespace splatboost {

struct GapPoint {
  glm::dvec3 position{0.0};  ///< world
  std::size_t view = 0;      ///< the view that it is taken from …
  glm::dvec2 pixel{0.0};     ///< … and where it is seen there, in pixels of ViewFeatures
};

/// Goes through the pixels of a regular grid in each view that need points (points_in_picture.h). Where no point is
/// seen within `spacing`, it adds one, which later views see too. Its depth is that of one of the nearest points in the
/// picture, the one at which the views around agree best on the grey values there, outside masks, refined in the range
/// of these depths. Pixels far from all points get none, and those whose point would be in free space (free_space.h).
/// The result does not depend on the number of threads.
/// @param known points that are there, world; each is taken to be seen in all views in front of which it is
/// @param pairs of views that see the same, of neighbouring_views()
/// @param spacing of the grid, × diagonal of the picture
/// @param background grey value of what renders show where there is no Gaussian
std::vector<GapPoint> fill_gaps(const std::vector<ViewFeatures>& views, std::span<const glm::dvec3> known,
                                const std::vector<std::pair<std::size_t, std::size_t>>& pairs, double spacing,
                                std::uint8_t background, const Threads& threads);

}  // namespace splatboost

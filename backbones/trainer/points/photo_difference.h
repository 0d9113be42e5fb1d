// SPDX-License-Identifier: Apache-2.0
/// @file How well two photos agree that a surface lies at some depth.
#pragma once

#include <optional>

#include <glm/vec2.hpp>

#include "trainer/features/view_features.h"

namespace splatboost {

/// Mean absolute difference of the grey values around a pixel, which are taken to lie at this depth (z in the view's
/// camera), to those of another view, in 5×5 pixels without those that are masked or outside of the picture. None if
/// the other view does not see all of them outside its mask.
std::optional<double> photo_difference(const ViewFeatures& view, const glm::dvec2& pixel, double depth,
                                       const ViewFeatures& other);

}  // namespace splatboost

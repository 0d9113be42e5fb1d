// SPDX-License-Identifier: Apache-2.0
/// @file Whether depth and pictures agree with the focal lengths that a user gave.
#pragma once

#include <optional>

#include "families/tracking/sparse_map.h"

namespace splatboost::tracking {

/// By what the focal lengths must be multiplied so that what two keyframes see together fits best to one rigid motion.
/// None where that is no surprise: where they fit about as well as they are, or motion or matches do not tell (a camera
/// that only shifts fits to any focal length).
std::optional<double> better_focal_factor(const SparseMap& map);

}  // namespace splatboost::tracking

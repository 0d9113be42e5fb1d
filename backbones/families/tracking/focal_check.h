// SPDX-License-Identifier: Apache-2.0
/// @file Check of the given focal lengths against images and depth.
#pragma once

#include <optional>

#include "families/tracking/sparse_map.h"

namespace splatboost::tracking {

/// Factor for the focal lengths with which the points shared by two keyframes fit a rigid motion best. None if the
/// given focal lengths fit about as well, or if motion and matches are inconclusive (any focal length fits a camera
/// that only translates).
std::optional<double> better_focal_factor(const SparseMap& map);

}  // namespace splatboost::tracking

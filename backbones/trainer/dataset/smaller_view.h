// SPDX-License-Identifier: Apache-2.0
/// @file Views with fewer pixels.
#pragma once

#include <vector>

#include "splatboost/threads.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

/// The view as seen by a camera with pixels `divisor` times as wide: the photo is averaged over blocks of pixels.
/// Incomplete blocks at the right and bottom edges are cut off; a block is valid if all of its pixels are.
View smaller_view(const View& view, int divisor);

/// Minimum width and height of a half-size view, in pixels.
inline constexpr int kMinHalfSide = 128;

/// The views at half their size; empty if any half would be smaller than kMinHalfSide.
std::vector<View> half_views(const std::vector<View>& views, const Threads& threads);

}  // namespace splatboost

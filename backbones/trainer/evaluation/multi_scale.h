// SPDX-License-Identifier: Apache-2.0
/// @file Views of a scene at other scales than it was trained at.
#pragma once

#include <array>
#include <vector>

#include "splatboost/threads.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

/// The scales of the field's protocol for one that was trained at 1: 1, 1/2, 1/4, 1/8.
inline constexpr std::array<int, 4> kScaleDivisors = {1, 2, 4, 8};

/// The view as a camera sees it whose pixels are `divisor` times as wide: truth averaged over blocks of pixels. A rim
/// that fills no block is cut off; a block is valid where all of its pixels are.
View smaller_view(const View& view, int divisor);

/// A side of a picture that is halved again has at least so many pixels left.
inline constexpr int kMinHalfSide = 64;

/// The views at half their size; none at all where one of them is too small for it.
std::vector<View> half_views(const std::vector<View>& views, Threads& threads);

}  // namespace splatboost

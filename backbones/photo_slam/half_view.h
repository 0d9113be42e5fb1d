// SPDX-License-Identifier: Apache-2.0
/// @file The next level of a keyframe's pyramid.
#pragma once

#include "trainer/dataset/scene.h"

namespace splatboost {

/// The view at half its size, by the means of 2 × 2 pixels; of those, only what is valid counts, and a pixel with none
/// is not valid. A last odd row or column is left out. The view must be at least 2 × 2 pixels large.
View half_view(const View& view);

}  // namespace splatboost

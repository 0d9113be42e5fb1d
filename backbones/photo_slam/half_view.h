// SPDX-License-Identifier: Apache-2.0
/// @file Downsampling of a view for the next level of a keyframe's pyramid.
#pragma once

#include "trainer/dataset/scene.h"

namespace splatboost {

/// The view at half its size, by averaging the valid pixels of 2 × 2 blocks; a block without valid pixels is invalid. A
/// last odd row or column is dropped. The view must have at least 2 × 2 pixels.
View half_view(const View& view);

}  // namespace splatboost

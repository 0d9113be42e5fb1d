// SPDX-License-Identifier: Apache-2.0
/// @file Times of photos from the numbers of their frames.
#pragma once

#include <string>
#include <vector>

#include "trainer/dataset/view_image.h"

namespace splatboost {

/// Takes the last number in each photo's file name for its frame (of cam2/take1_0007.png the 7) and spreads times over
/// [0,1] from the first frame to the last. Throws InputError, beginning with `where`, if a name has no number or all
/// have the same.
void set_frame_times(std::vector<Photo>& photos, const std::string& where);

}  // namespace splatboost

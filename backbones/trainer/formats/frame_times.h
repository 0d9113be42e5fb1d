// SPDX-License-Identifier: Apache-2.0
/// @file Times of photos from their frame numbers.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "trainer/dataset/view_image.h"

namespace splatboost {

/// The last number in the file name, without its extension; -1 if there is none or it is out of range.
std::int64_t frame_number(const std::string& name);

/// Takes the last number in each photo's file name as its frame number (7 for cam2/take1_0007.png), and sets times that
/// are linear in it, from 0 for the first frame to 1 for the last. Throws InputError, beginning with `where`, if a name
/// has no number or all numbers are equal.
/// @return a note for the user: in some names the last number is not that of the frame
std::string set_frame_times(std::vector<Photo>& photos, const std::string& where);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file The size of a picture, from the header of its file.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "trainer/dataset/view_image.h"

namespace splatboost {

/// The size that the header of a PNG or JPEG file states, without decoding it; none for other files, and if there is no
/// such header. For files from outside, of which a small one can ask for gigabytes.
std::optional<ImageSize> size_in_header(std::span<const std::uint8_t> file);

}  // namespace splatboost

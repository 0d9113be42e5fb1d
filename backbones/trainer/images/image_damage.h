// SPDX-License-Identifier: Apache-2.0
/// @file Damage of image files that decoders do not report, or report only on stderr.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace splatboost {

/// Whether a file begins with these bytes.
bool has_magic(std::span<const std::uint8_t> file, std::string_view magic);

/// Throws InputError, beginning with `where`, if the file is empty, or a PNG, JPEG or BMP that is cut short or damaged.
void require_whole_image(std::span<const std::uint8_t> file, const std::string& where);

}  // namespace splatboost

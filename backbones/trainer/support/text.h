// SPDX-License-Identifier: Apache-2.0
/// @file UTF-8 validation and escaping of external text, the order of numbered names, and numbers in messages.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace splatboost {

/// Whether the bytes are well-formed UTF-8 (RFC 3629: no overlong forms, no surrogates).
bool is_utf8(std::string_view text);

/// The text, with control characters and bytes that are not valid UTF-8 written as \xNN.
std::string printable(std::string_view text);

/// The text as one word for a POSIX shell: in quotes if a character in it has a meaning there.
std::string shell_word(std::string_view text);

/// Whether name `a` comes before `b` if runs of digits are compared as numbers: frame2.png before frame10.png.
bool in_number_order(std::string_view a, std::string_view b);

/// "1 keyframe", "2 keyframes". @param noun singular, whose plural ends in s
std::string counted(std::size_t count, const std::string& noun);

}  // namespace splatboost

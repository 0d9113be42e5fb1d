// SPDX-License-Identifier: Apache-2.0
/// @file UTF-8 validation and escaping of external text.
#pragma once

#include <string>
#include <string_view>

namespace splatboost {

/// Whether the bytes are well-formed UTF-8 (RFC 3629: no overlong forms, no surrogates).
bool is_utf8(std::string_view text);

/// The text, with control characters and bytes that are not valid UTF-8 written as \xNN.
std::string printable(std::string_view text);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file SHA-256 (FIPS 180-4), by which a manifest identifies files; `sha256sum` prints the same.
#pragma once

#include <string>
#include <string_view>

namespace splatboost::patch {

/// @return 64 lower-case hexadecimal digits
std::string sha256(std::string_view bytes);

}  // namespace splatboost::patch

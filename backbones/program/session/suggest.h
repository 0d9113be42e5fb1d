// SPDX-License-Identifier: Apache-2.0
/// @file "Did you mean": the nearest of some names.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace splatboost::program {

/// The name nearest to a mistyped one, or empty if none is near: by insertions, deletions, changes and swaps of
/// neighbours, of which a third of the letters may be wrong.
std::string nearest_name(std::string_view wrong, const std::vector<std::string>& names);

/// "; did you mean NEAREST?" or nothing.
std::string did_you_mean(std::string_view wrong, const std::vector<std::string>& names);

}  // namespace splatboost::program

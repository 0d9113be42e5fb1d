// SPDX-License-Identifier: Apache-2.0
/// @file "Did you mean": the nearest of some names.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace splatboost::program {

/// The name nearest to a mistyped one by edit distance (insertions, deletions, substitutions and swaps of neighbours),
/// or empty if more than about a third of the letters are wrong.
std::string nearest_name(std::string_view wrong, const std::vector<std::string>& names);

/// "; did you mean NEAREST?" or an empty text.
std::string did_you_mean(std::string_view wrong, const std::vector<std::string>& names);

}  // namespace splatboost::program

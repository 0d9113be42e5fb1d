// SPDX-License-Identifier: Apache-2.0
/// @file Unified diffs, in the format that `diff -u` writes and `git apply` reads.
#pragma once

#include <string>
#include <string_view>

namespace splatboost::patch {

struct Diff {
  std::string text;  ///< headers a/PATH and b/PATH, hunks with three lines of context; empty if nothing differs
  int added = 0;     ///< lines
  int removed = 0;
};

Diff unified_diff(std::string_view before, std::string_view after, const std::string& path);

}  // namespace splatboost::patch

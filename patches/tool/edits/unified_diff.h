// SPDX-License-Identifier: Apache-2.0
/// @file What a patch changes, as `diff -u` and `git apply` write and read it.
#pragma once

#include <string>
#include <string_view>

namespace splatboost::patch {

struct Diff {
  std::string text;  ///< headers a/PATH and b/PATH, hunks of three lines of context; empty where nothing differs
  int added = 0;     ///< lines
  int removed = 0;
};

Diff unified_diff(std::string_view before, std::string_view after, const std::string& path);

}  // namespace splatboost::patch

// SPDX-License-Identifier: Apache-2.0
/// @file How near a recipe comes to a tree: which of its signs, anchors and needs hold there, and what stands where
/// others do not.
#pragma once

#include <string>
#include <vector>

#include "tool/recipe.h"

namespace splatboost::patch {

enum class Sought { sign, anchor, need };

/// One thing that a recipe looks for.
struct Finding {
  Sought sought = Sought::sign;
  std::string file;
  std::string what;   ///< in a few words
  int line = 0;       ///< where an anchor stands first; 0: not told
  std::string wrong;  ///< what is there instead; empty: it holds
};

struct Diagnosis {
  std::string recipe;
  std::string layout;
  std::vector<Finding> findings;  ///< in the order of the recipe

  int all(Sought sought) const;
  int held(Sought sought) const;
  /// Part of all that holds, in [0, 1].
  double likeness() const;
};

/// One for every layout of a recipe. Nothing is written.
std::vector<Diagnosis> diagnose(const Recipe& recipe, const FileReader& read);

}  // namespace splatboost::patch

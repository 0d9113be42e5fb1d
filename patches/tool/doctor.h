// SPDX-License-Identifier: Apache-2.0
/// @file How closely a tree matches a recipe: which of its signs, anchors and needs hold, and for the others what the
/// tree has instead.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "tool/recipe.h"

namespace splatboost::patch {

enum class Sought { sign, anchor, need };

/// One thing that a recipe looks for.
struct Finding {
  Sought sought = Sought::sign;
  std::string file;
  std::string what;   ///< short description
  int line = 0;       ///< of the first occurrence of an anchor; 0: unknown
  std::string wrong;  ///< what is there instead; empty: it holds
};

struct Diagnosis {
  std::string recipe;
  std::string layout;
  std::vector<Finding> findings;  ///< in the order of the recipe

  int all(Sought sought) const;
  int held(Sought sought) const;
  /// Fraction of the findings that hold, in [0, 1].
  double likeness() const;
};

/// Returns one diagnosis per layout of the recipe. Writes nothing.
std::vector<Diagnosis> diagnose(const Recipe& recipe, const FileReader& read);

/// The host's files that contain lines of a recipe's edits, whatever their indentation: those of a patched tree. For
/// trees without a record of the patch.
std::set<std::string> edited_files(const Recipe& recipe, const FileReader& read);

}  // namespace splatboost::patch

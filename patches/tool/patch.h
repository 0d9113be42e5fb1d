// SPDX-License-Identifier: Apache-2.0
/// @file Patches a backbone's checkout, tells how it stands, and takes the patch back.
///
/// Every call throws PatchError with one line (file, anchor, what to do) and leaves the tree as it was. Where the
/// machine stops in the middle of its writes, or the disk refuses to take them back, each file is as before or as
/// after; the manifest or leftovers() tell it, and revert() mends it.
#pragma once

#include <string>
#include <vector>

#include "tool/edits/unified_diff.h"
#include "tool/manifest.h"
#include "tool/recipe.h"
#include "tool/source_tree.h"

namespace splatboost::patch {

/// What a call changed, or would.
struct Outcome {
  bool nothing_to_do = false;  ///< the tree was so already
  std::string recipe;
  std::string layout;
  std::string diff;  ///< of all files
  int added = 0;     ///< lines
  int removed = 0;   ///< lines
  std::vector<std::string> files;
  std::vector<std::string> edited_by_user;  ///< files that hold changes of the user's besides
  std::vector<std::string> leftovers;       ///< files that an interrupted command left; apply and revert remove them
};

enum class Writing { dry_run, write };

/// Applies a recipe. A second time there is nothing to do.
Outcome apply(const Recipe& recipe, const SourceTree& tree, Writing writing);

/// Takes the patch back: to the byte where the files are as the patch left them; changes of the user's stay. Mends a
/// tree whose apply or revert was interrupted.
Outcome revert(const SourceTree& tree, Writing writing);

/// What interrupted commands left in the tree besides a manifest.
std::vector<std::string> leftovers(const SourceTree& tree, const std::optional<Manifest>& manifest);

/// Checks that a patch is in place, whole and once, and tells how many lines it is.
Outcome verify(const SourceTree& tree);

}  // namespace splatboost::patch

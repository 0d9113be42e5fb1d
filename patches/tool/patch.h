// SPDX-License-Identifier: Apache-2.0
/// @file Applies a patch to a backbone's checkout, verifies it, and reverts it.
///
/// On failure every call throws PatchError with one line (file, anchor, what to do) and leaves the tree unchanged. If
/// the machine stops during the writes, or undoing them fails, each file is either in its old or in its new state; the
/// manifest or leftovers() shows that, and revert() repairs it.
#pragma once

#include <string>
#include <vector>

#include "tool/edits/unified_diff.h"
#include "tool/manifest.h"
#include "tool/recipe.h"
#include "tool/source_tree.h"

namespace splatboost::patch {

/// What a call changed, or would change in a dry run.
struct Outcome {
  bool nothing_to_do = false;  ///< the tree was already in the requested state
  std::string recipe;
  std::string layout;
  std::string diff;  ///< of all files
  int added = 0;     ///< lines
  int removed = 0;   ///< lines
  std::vector<std::string> files;
  std::vector<std::string> edited_by_user;  ///< patched files that the user has also changed
  std::vector<std::string> leftovers;       ///< files that an interrupted command left; apply and revert remove them
};

enum class Writing { dry_run, write };

/// Applies a recipe. Applying it again does nothing.
Outcome apply(const Recipe& recipe, const SourceTree& tree, Writing writing);

/// Reverts the patch: files that the user has not changed become byte-identical to the originals; in the others the
/// user's changes are kept. Repairs a tree whose apply or revert was interrupted.
Outcome revert(const SourceTree& tree, Writing writing);

/// Files that interrupted commands left in the tree, other than the manifest.
std::vector<std::string> leftovers(const SourceTree& tree, const std::optional<Manifest>& manifest);

/// Checks that the patch is applied completely and only once, and reports how many lines it adds and removes.
Outcome verify(const SourceTree& tree);

}  // namespace splatboost::patch

// SPDX-License-Identifier: Apache-2.0
/// @file Record of what was done to a tree: its .splatboost/patch.json, which exists from the first write of an apply
/// to the last write of a revert.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tool/edits/text_edit.h"
#include "tool/source_tree.h"

namespace splatboost::patch {

inline constexpr const char* kManifestFile = ".splatboost/patch.json";
/// Makes git ignore the folder, so that git clean and git stash leave the record in place.
inline constexpr const char* kIgnoreFile = ".splatboost/.gitignore";

enum class State {
  applying,  ///< some files may be patched
  applied,
  reverting  ///< some files may be unpatched
};

struct PatchedFile {
  std::string file;
  std::string before;           ///< SHA-256 without the patch; empty: the patch adds the file
  std::string after;            ///< SHA-256 with it
  std::string reverted;         ///< SHA-256 after the revert in progress: `before`, unless the user edited the file
  std::vector<Change> changes;  ///< in the order they were made

  bool brought() const { return before.empty(); }
};

struct Manifest {
  std::string recipe;
  std::string recipe_sha256;
  std::string layout;
  State state = State::applying;
  std::vector<PatchedFile> files;
};

/// @return nullopt if the tree is not patched. Throws PatchError if the manifest is not valid.
std::optional<Manifest> read_manifest(const SourceTree& tree);

/// The text of the manifest file.
std::string text_of(const Manifest& manifest);

}  // namespace splatboost::patch

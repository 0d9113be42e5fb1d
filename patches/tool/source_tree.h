// SPDX-License-Identifier: Apache-2.0
/// @file The host's files: read within the tree only, written all or none.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace splatboost::patch {

/// New content of a file. nullopt removes it.
struct FileChange {
  std::string file;  ///< relative to the tree
  std::optional<std::string> content;
};

/// Called before each rename of a commit, with the file; tests let it throw or end the process.
using CommitObserver = std::function<void(const std::string& file)>;

class SourceTree {
 public:
  /// @param root a folder; symbolic links to it are followed, once and for all
  explicit SourceTree(const std::filesystem::path& root);

  const std::filesystem::path& root() const { return root_; }

  /// Text of a file, nullopt where there is none. PatchError if a link on the way leads out of the tree.
  std::optional<std::string> read(const std::string& file) const;

  /// PatchError unless the file is a regular one that may be replaced.
  void require_writable(const std::string& file) const;

  /// Puts all contents in place. They are written and on disk beside their files before the first is renamed; if
  /// anything fails then, what was renamed is put back and the failure thrown on. Links and permissions stay.
  void commit(const std::vector<FileChange>& changes, const CommitObserver& observer = {}) const;

  /// Writes or removes one file at once, for the record of what is under way. Makes its folder, and removes it when
  /// it is left empty.
  void commit_record(const FileChange& change) const;

  /// Removes what an interrupted commit left beside these files.
  void remove_leftovers(const std::vector<std::string>& files) const;

 private:
  /// Where a file really is. PatchError if that is outside the tree.
  std::filesystem::path resolve(const std::string& file) const;

  std::filesystem::path root_;
};

}  // namespace splatboost::patch

// SPDX-License-Identifier: Apache-2.0
/// @file The host's files: read within the tree only, written all or none.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace splatboost::patch {

/// New content of a file.
struct FileChange {
  std::string file;                    ///< relative to the tree; one that is not there is made, with its folder
  std::optional<std::string> content;  ///< nullopt removes the file, and its folder if that is left empty
};

/// A change of several files, with a record in the tree that tells what is under way while it is.
struct Transaction {
  std::vector<FileChange> changes;
  std::string record;                     ///< its file, relative to the tree
  std::string under_way;                  ///< its content from the first change of a file to the last
  std::optional<std::string> afterwards;  ///< its content then; nullopt removes it
};

enum class FileOperation { make_folder, create, write, rename, remove, remove_folder };

/// Called before each operation that changes the disk. Returns the errno with which the operation fails; 0 lets it
/// happen. Tests fail operations with it, or end the process there.
using FileHook = std::function<int(FileOperation operation, const std::filesystem::path& path)>;

class SourceTree {
 public:
  /// @param root a folder; symbolic links to it are followed, once and for all
  explicit SourceTree(const std::filesystem::path& root, FileHook hook = {});

  const std::filesystem::path& root() const { return root_; }

  /// Text of a file, nullopt where there is none. PatchError if a link on the way leads out of the tree.
  std::optional<std::string> read(const std::string& file) const;

  /// PatchError unless the file is a regular one that may be replaced.
  void require_writable(const std::string& file) const;

  /// PatchError if the file is there, or cannot be made since its folder is none.
  void require_free(const std::string& file) const;

  /// Puts all contents in place, or none. New and old contents, and the last record, are on disk beside their files
  /// before the first file is renamed, so that neither going on nor going back needs space after that. WriteError if
  /// the disk refuses: the tree is as it was, or the message says what is left to do. Links and permissions stay.
  void commit(const Transaction& transaction) const;

  /// Removes a record, and its folder if that is left empty.
  void remove_record(const std::string& record) const;

  /// What interrupted commits left beside these files and the record; folders of them where nothing else is.
  std::vector<std::string> leftovers(const std::vector<std::string>& files, const std::string& record) const;

  /// Removes these. WriteError if the disk refuses.
  void remove_leftovers(const std::vector<std::string>& leftovers) const;

 private:
  /// Where a file really is. PatchError if that is outside the tree.
  std::filesystem::path resolve(const std::string& file) const;

  int begin(FileOperation operation, const std::filesystem::path& path) const;
  /// These return an errno, or 0. What is not there is removed already.
  int make_folder(const std::filesystem::path& folder) const;
  int write(const std::filesystem::path& path, const std::string& content, unsigned mode) const;
  int rename(const std::filesystem::path& from, const std::filesystem::path& to) const;
  int remove(const std::filesystem::path& path) const;
  int remove_folder_if_empty(const std::filesystem::path& folder) const;

  std::filesystem::path root_;
  FileHook hook_;
};

}  // namespace splatboost::patch

// SPDX-License-Identifier: Apache-2.0
/// @file Access to the host's files: only files inside the tree are read, and several are written all or none.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace splatboost::patch {

/// New content of a file.
struct FileChange {
  std::string file;                    ///< relative to the tree; created, with its folder, if missing
  std::optional<std::string> content;  ///< nullopt removes the file, and its folder if that becomes empty
};

/// A change of several files. While it is in progress, a record file in the tree says so.
struct Transaction {
  std::vector<FileChange> changes;
  std::string record;                     ///< path of the record file, relative to the tree
  std::string under_way;                  ///< its content while the files are being changed
  std::optional<std::string> afterwards;  ///< its content after that; nullopt removes it
};

enum class FileOperation { make_folder, create, write, rename, remove, remove_folder };

/// Called before each operation that changes the disk. Returns the errno with which the operation fails, or 0 to let it
/// proceed. Tests use it to make operations fail or to end the process at that point.
using FileHook = std::function<int(FileOperation operation, const std::filesystem::path& path)>;

/// Keeps other commands from changing the same tree until it is destroyed.
class TreeLock {
 public:
  explicit TreeLock(int descriptor) : descriptor_(descriptor) {}
  ~TreeLock();
  TreeLock(const TreeLock&) = delete;
  TreeLock& operator=(const TreeLock&) = delete;

 private:
  int descriptor_;  ///< of the tree's folder, locked; below 0: the file system has no locks
};

class SourceTree {
 public:
  /// @param root a folder; symbolic links in its path are resolved once, here
  explicit SourceTree(const std::filesystem::path& root, FileHook hook = {});

  const std::filesystem::path& root() const { return root_; }

  /// Text of a file; nullopt if it does not exist. Throws PatchError if a symbolic link leads out of the tree.
  std::optional<std::string> read(const std::string& file) const;

  /// Throws PatchError unless this is a regular file that may be replaced.
  void require_writable(const std::string& file) const;

  /// Throws PatchError if the file exists or cannot be created in its folder.
  void require_free(const std::string& file) const;

  /// Waits until no other command changes the tree. To be held from the first read on which a change depends. Where the
  /// file system has no locks, it holds nothing.
  [[nodiscard]] std::unique_ptr<TreeLock> lock() const;

  /// Writes all contents, or none. The new and old contents and the final record are on disk next to their files before
  /// the first file is renamed, so that neither completing nor rolling back needs disk space after that. Throws
  /// WriteError if a write fails: the tree is unchanged, or the message says what is left to do. Keeps symbolic links,
  /// permissions and, as far as permitted, owners.
  void commit(const Transaction& transaction) const;

  /// Removes a record, and its folder if that becomes empty.
  void remove_record(const std::string& record) const;

  /// Files that interrupted commits left next to these files and the record, and folders that contain nothing else.
  std::vector<std::string> leftovers(const std::vector<std::string>& files, const std::string& record) const;

  /// Removes these. Throws WriteError if that fails.
  void remove_leftovers(const std::vector<std::string>& leftovers) const;

 private:
  /// Path of a file with symbolic links resolved. Throws PatchError if that is outside the tree.
  std::filesystem::path resolve(const std::string& file) const;

  int begin(FileOperation operation, const std::filesystem::path& path) const;
  /// The following return 0 or an errno. Removing what does not exist succeeds.
  int make_folder(const std::filesystem::path& folder) const;
  /// @param like the file whose permissions and owner the new one gets; it may not exist yet
  int write(const std::filesystem::path& path, const std::string& content, const std::filesystem::path& like) const;
  int rename(const std::filesystem::path& from, const std::filesystem::path& to) const;
  int remove(const std::filesystem::path& path) const;
  int remove_folder_if_empty(const std::filesystem::path& folder) const;

  std::filesystem::path root_;
  FileHook hook_;
};

}  // namespace splatboost::patch

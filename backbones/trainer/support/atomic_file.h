// SPDX-License-Identifier: Apache-2.0
/// @file Files appear whole or not at all; one process at a time writes into a folder.
#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <string>

namespace splatboost {

/// Lets `write` fill a temporary file beside `path` and renames it onto `path` once all bytes are on disk. On failure
/// (disk full, no permission) the old file stays, the new one is removed, and std::runtime_error names path and cause.
void write_file_atomically(const std::filesystem::path& path, const std::function<void(std::ostream&)>& write);

/// Same for text at hand.
void write_text_atomically(const std::filesystem::path& path, const std::string& text);

/// Whether a file of this name is a temporary file of write_file_atomically() or the lock file of FolderLock.
bool is_working_file(const std::filesystem::path& name);

/// Removes the temporary files in the folder, not below it, that processes left which were killed. Those of processes
/// that still write stay: each holds a lock on its own, which the kernel releases when the process ends.
void remove_stale_files(const std::filesystem::path& folder);

/// Whether it is a regular file. Throws InputError where the permissions of a folder keep that from being known.
bool is_file(const std::filesystem::path& path);

/// Makes the folder and those above it, and calls remove_stale_files() on it. Throws std::runtime_error naming it and
/// the cause.
void make_folder(const std::filesystem::path& folder);

/// Keeps other processes that ask for the same lock out of a folder, while it lives. Its file `.splatboost.lock` stays
/// after a kill, but the lock ends with the process. On a file system without locks it does nothing.
class FolderLock {
 public:
  /// Throws InputError if another process has the lock, or if the folder, which must exist, cannot be written to.
  explicit FolderLock(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(FolderLock&& other) noexcept;
  FolderLock& operator=(FolderLock&& other) noexcept;

 private:
  std::filesystem::path file_;
  int descriptor_ = -1;
};

}  // namespace splatboost

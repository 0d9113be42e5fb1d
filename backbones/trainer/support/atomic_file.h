// SPDX-License-Identifier: Apache-2.0
/// @file Atomic writing of files, and locks that let one process at a time write into a folder.
#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <string>

namespace splatboost {

/// The file that writing to `path` replaces: the existing file that a symbolic link points to, else `path`. Throws
/// InputError if it is a device or a pipe, std::runtime_error if it is a folder or `path` is empty.
std::filesystem::path file_to_replace(const std::filesystem::path& path);

/// Throws what write_file_atomically() would throw if `path` cannot be written, for use before long work. Changes
/// nothing.
void require_writable(const std::filesystem::path& path);

/// Calls `write` on a temporary file beside `path`, and renames that to `path` once all bytes are on disk. On failure
/// (disk full, no permission) an old file is kept, the new one is removed, and std::runtime_error names path and cause.
/// Links, folders, devices and pipes are treated as file_to_replace() says.
void write_file_atomically(const std::filesystem::path& path, const std::function<void(std::ostream&)>& write);

/// Same, with `text` as the content.
void write_text_atomically(const std::filesystem::path& path, const std::string& text);

/// Whether a file of this name is a temporary file of write_file_atomically() or the lock file of FolderLock.
bool is_working_file(const std::filesystem::path& name);

/// Removes the temporary files that killed processes left in the folder (not in its subfolders). Those of processes
/// still writing are kept: each is locked, and the kernel releases the lock when the process ends.
void remove_stale_files(const std::filesystem::path& folder);

/// Whether `path` is a regular file. Throws InputError if folder permissions prevent the check.
bool is_file(const std::filesystem::path& path);

/// Creates the folder and its parents, and calls remove_stale_files() on it. Throws std::runtime_error naming the
/// folder and the cause.
void make_folder(const std::filesystem::path& folder);

/// Locks a folder, for the lifetime of this object, against other processes that use FolderLock. If the process is
/// killed, the file `.splatboost.lock` remains, but is no longer locked. Does nothing on a file system without locks.
class FolderLock {
 public:
  /// Throws InputError if another process has the lock, or if the folder does not exist or cannot be written to.
  explicit FolderLock(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(FolderLock&& other) noexcept;
  FolderLock& operator=(FolderLock&& other) noexcept;

 private:
  std::filesystem::path file_;
  int descriptor_ = -1;
};

}  // namespace splatboost

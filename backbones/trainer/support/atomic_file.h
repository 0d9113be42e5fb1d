// SPDX-License-Identifier: Apache-2.0
/// @file Atomic writing of files, and locks that let one process at a time write into a folder.
#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

namespace splatboost {

/// The file that writing to `path` replaces: the existing file that a symbolic link points to, else `path`. Throws
/// InputError if it is a folder, a device or a pipe, or if `path` is empty.
std::filesystem::path file_to_replace(const std::filesystem::path& path);

/// Throws what write_file_atomically() would throw if `path` cannot be written, for use before long work. Changes
/// nothing.
void require_writable(const std::filesystem::path& path);

/// Throws InputError if `folder` cannot be made, with those above it, or not be written to. Changes nothing.
void require_writable_folder(const std::filesystem::path& folder);

/// Throws InputError if writing to `output` would replace one of the command's `inputs` (under this or another name;
/// those that do not exist are skipped), or would write into the saved models of a run: the folder `point_cloud` beside
/// a config.json. For outputs that the user names, before anything is written.
void require_replaceable(const std::filesystem::path& output, const std::vector<std::filesystem::path>& inputs);

/// A new, empty file beside `target`, for libraries that write to a file name. It is locked, so that
/// remove_stale_files() keeps it. The destructor removes it unless it was renamed.
struct TemporaryFile {
  std::filesystem::path path;
  int descriptor = -1;
  bool renamed = false;

  /// @param ending of the name, such as ".mp4", for libraries that choose a format by it
  /// Throws InputError if the folder does not exist or must not be written to, std::runtime_error on other failures.
  explicit TemporaryFile(const std::filesystem::path& target, std::string_view ending = {});
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile();
};

/// Calls `write` on a temporary file beside `path`, and renames that to `path` once all bytes are on disk. On failure
/// (disk full) an old file is kept, the new one is removed, and std::runtime_error names path and cause. It is an
/// InputError if the file cannot be created because its folder does not exist or permission is missing. Links, folders,
/// devices and pipes are treated as file_to_replace() says.
void write_file_atomically(const std::filesystem::path& path, const std::function<void(std::ostream&)>& write);

/// Same, with `text` as the content.
void write_text_atomically(const std::filesystem::path& path, const std::string& text);

/// Calls `write`, which writes the second file of a pair. If it throws, removes `first`, which cannot be used alone.
void write_second_file(const std::filesystem::path& first, const std::function<void()>& write);

/// Throws InputError, with advice, if the second file of a pair is missing.
void require_second_file(const std::filesystem::path& file);

/// Whether a file of this name is a TemporaryFile or the lock file of FolderLock.
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

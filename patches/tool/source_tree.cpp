// SPDX-License-Identifier: Apache-2.0
#include "tool/source_tree.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>
#include <utility>

#include "tool/patch_error.h"

namespace splatboost::patch {
namespace {

namespace fs = std::filesystem;

constexpr const char* kNew = ".splatboost-new";
constexpr mode_t kOwnerWrite = 0200;

[[noreturn]] void fail(const fs::path& path, int error) {
  throw PatchError(path.string() + ": cannot be written: " + std::strerror(error));
}

fs::path beside(const fs::path& path) { return fs::path(path) += kNew; }

/// Names are on disk only once their folder is.
void sync_folder(const fs::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  (void)::fsync(descriptor);
  ::close(descriptor);
}

/// Writes `content` beside `path`, with the permissions of the file there. What was begun goes on failure.
void stage(const fs::path& path, const std::string& content) {
  const fs::path staged = beside(path);
  struct stat old_status {};
  const mode_t mode = ::stat(path.c_str(), &old_status) == 0 ? old_status.st_mode & 07777 : 0644;
  const int descriptor = ::open(staged.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (descriptor < 0) fail(path, errno);
  int error = 0;
  for (std::size_t at = 0; at < content.size() && error == 0;) {
    const ssize_t written = ::write(descriptor, content.data() + at, content.size() - at);
    if (written >= 0) {
      at += static_cast<std::size_t>(written);
    } else if (errno != EINTR) {
      error = errno;
    }
  }
  if (error == 0 && ::fchmod(descriptor, mode) != 0) error = errno;
  if (error == 0 && ::fsync(descriptor) != 0 && errno != EINVAL && errno != ENOTSUP) error = errno;
  if (::close(descriptor) != 0 && error == 0) error = errno;
  if (error != 0) {
    ::unlink(staged.c_str());
    fail(path, error);
  }
}

void unstage(const fs::path& path) { ::unlink(beside(path).c_str()); }

void put_in_place(const fs::path& path) {
  if (::rename(beside(path).c_str(), path.c_str()) != 0) fail(path, errno);
}

std::string content_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  require(in.good(), path.string() + ": cannot be read");
  return text.str();
}

}  // namespace

SourceTree::SourceTree(const fs::path& root) {
  std::error_code error;
  require(fs::is_directory(root, error), root.string() + ": is not a folder; give that of the backbone's checkout");
  root_ = fs::canonical(root);
}

fs::path SourceTree::resolve(const std::string& file) const {
  std::error_code error;
  const fs::path path = fs::weakly_canonical(root_ / file, error);
  require(!error, file + ": cannot be reached: " + error.message());
  const auto [end_of_root, ignored] = std::mismatch(root_.begin(), root_.end(), path.begin(), path.end());
  require(end_of_root == root_.end(),
          file + ": leads out of the tree, to " + path.string() + ": nothing is followed there");
  return path;
}

std::optional<std::string> SourceTree::read(const std::string& file) const {
  const fs::path path = resolve(file);
  std::error_code error;
  if (!fs::exists(path, error)) return std::nullopt;
  require(fs::is_regular_file(path, error), file + ": is not a file");
  return content_of(path);
}

void SourceTree::require_writable(const std::string& file) const {
  const fs::path path = resolve(file);
  struct stat status {};
  require(::stat(path.c_str(), &status) == 0, file + ": is missing");
  require(S_ISREG(status.st_mode), file + ": is not a file");
  // Root may write anywhere; a file without the permission was protected on purpose all the same.
  require((status.st_mode & kOwnerWrite) != 0, file + ": is read-only: allow writing with chmod u+w " + path.string());
  require(::access(path.parent_path().c_str(), W_OK) == 0,
          file + ": its folder is read-only: allow writing with chmod u+w " + path.parent_path().string());
}

void SourceTree::commit(const std::vector<FileChange>& changes, const CommitObserver& observer) const {
  struct Step {
    fs::path path;
    std::string old_content;
  };
  std::vector<Step> steps;
  for (const FileChange& change : changes) {
    require_writable(change.file);
    const fs::path path = resolve(change.file);
    for (const Step& step : steps) require(step.path != path, change.file + ": two names of one file");
    steps.push_back({path, content_of(path)});
  }
  std::size_t staged = 0, renamed = 0;
  try {
    for (; staged < steps.size(); ++staged) stage(steps[staged].path, changes[staged].content.value());
    for (; renamed < steps.size(); ++renamed) {
      if (observer) observer(changes[renamed].file);
      put_in_place(steps[renamed].path);
    }
  } catch (...) {
    for (std::size_t i = renamed; i < staged; ++i) unstage(steps[i].path);
    for (std::size_t i = 0; i < renamed; ++i) {
      stage(steps[i].path, steps[i].old_content);
      put_in_place(steps[i].path);
    }
    throw;
  }
  for (const Step& step : steps) sync_folder(step.path.parent_path());
}

void SourceTree::commit_record(const FileChange& change) const {
  const fs::path path = resolve(change.file);
  const fs::path folder = path.parent_path();
  std::error_code error;
  if (change.content) {
    const bool made = fs::create_directory(folder, error);
    if (error) fail(folder, error.value());
    try {
      stage(path, *change.content);
      put_in_place(path);
    } catch (...) {
      unstage(path);
      if (made) fs::remove(folder, error);
      throw;
    }
    sync_folder(folder);
  } else {
    unstage(path);
    if (::unlink(path.c_str()) != 0 && errno != ENOENT) fail(path, errno);
    fs::remove(folder, error);  // fails where somebody keeps something there
  }
  sync_folder(folder.parent_path());
}

void SourceTree::remove_leftovers(const std::vector<std::string>& files) const {
  for (const std::string& file : files) unstage(resolve(file));
}

}  // namespace splatboost::patch

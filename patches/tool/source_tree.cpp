// SPDX-License-Identifier: Apache-2.0
#include "tool/source_tree.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <set>
#include <sstream>
#include <utility>

#include "tool/patch_error.h"

namespace splatboost::patch {
namespace {

namespace fs = std::filesystem;

constexpr const char* kNew = ".splatboost-new";  // new content, not yet in place
constexpr const char* kOld = ".splatboost-old";  // old content, kept until all new content is in place
constexpr mode_t kOwnerWrite = 0200;

[[noreturn]] void fail(const fs::path& path, int error) {
  throw WriteError(path.string() + ": cannot be written: " + std::strerror(error));
}

fs::path beside(const fs::path& path, const char* ending) { return fs::path(path) += ending; }

struct Rights {
  mode_t mode = 0644;
  uid_t owner = ::geteuid();
  gid_t group = ::getegid();
};

/// Rights of a file. A new file gets the owner of its folder, so that root leaves files that the tree's owner can
/// revert.
Rights rights_of(const fs::path& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) == 0) return {status.st_mode & 07777, status.st_uid, status.st_gid};
  if (::stat(path.parent_path().c_str(), &status) == 0) return {0644, status.st_uid, status.st_gid};
  return {};
}

/// Whether changing the owner succeeded, or failed only because this user or file system does not permit it.
bool is_given(int changed) { return changed == 0 || errno == EPERM || errno == EINVAL; }

/// New names of files are on disk only after their folder is synced.
void sync_folder(const fs::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  (void)::fsync(descriptor);
  ::close(descriptor);
}

std::string content_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in.good()) throw ReadError(path.string() + ": cannot be read");
  return text.str();
}

}  // namespace

TreeLock::~TreeLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

SourceTree::SourceTree(const fs::path& root, FileHook hook) : hook_(std::move(hook)) {
  std::error_code error;
  require(fs::is_directory(root, error),
          root.string() + ": is not a folder; give the folder of the backbone's checkout");
  root_ = fs::canonical(root);
}

fs::path SourceTree::resolve(const std::string& file) const {
  std::error_code error;
  fs::path path = fs::weakly_canonical(root_ / file, error);
  require(!error, file + ": cannot be reached: " + error.message());
  const auto [end_of_root, ignored] = std::mismatch(root_.begin(), root_.end(), path.begin(), path.end());
  require(end_of_root == root_.end(),
          file + ": leads out of the tree, to " + path.string() + ": links out of the tree are not followed");
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
  // Root may write anywhere, but a file without the permission was protected on purpose.
  require((status.st_mode & kOwnerWrite) != 0, file + ": is read-only: allow writing with chmod u+w " + path.string());
  require(::access(path.parent_path().c_str(), W_OK) == 0,
          file + ": its folder is read-only: allow writing with chmod u+w " + path.parent_path().string());
}

void SourceTree::require_free(const std::string& file) const {
  std::error_code error;
  const fs::path path = resolve(file);
  require(!fs::exists(fs::symlink_status(path, error)),
          file + ": exists already, and the patch adds a file of this name: move it away, then patch");
  const fs::path folder = path.parent_path();
  require(!fs::exists(folder, error) || fs::is_directory(folder, error), file + ": its folder is a file: move it away");
  const fs::path above = fs::exists(folder, error) ? folder : folder.parent_path();
  require(fs::is_directory(above, error), file + ": there is no folder " + above.string());
  require(::access(above.c_str(), W_OK) == 0,
          file + ": its folder is read-only: allow writing with chmod u+w " + above.string());
}

std::unique_ptr<TreeLock> SourceTree::lock() const {
  const int descriptor = ::open(root_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  while (descriptor >= 0 && ::flock(descriptor, LOCK_EX) != 0 && errno == EINTR) {
  }
  return std::make_unique<TreeLock>(descriptor);
}

int SourceTree::begin(FileOperation operation, const fs::path& path) const {
  return hook_ ? hook_(operation, path) : 0;
}

int SourceTree::make_folder(const fs::path& folder) const {
  if (const int error = begin(FileOperation::make_folder, folder)) return error;
  const Rights rights = rights_of(folder);
  if (::mkdir(folder.c_str(), 0777) != 0) return errno;
  return is_given(::lchown(folder.c_str(), rights.owner, rights.group)) ? 0 : errno;
}

int SourceTree::write(const fs::path& path, const std::string& content, const fs::path& like) const {
  const Rights rights = rights_of(like);
  if (const int error = begin(FileOperation::create, path)) return error;
  const int descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (descriptor < 0) return errno;
  int error = begin(FileOperation::write, path);
  for (std::size_t at = 0; at < content.size() && error == 0;) {
    const ssize_t written = ::write(descriptor, content.data() + at, content.size() - at);
    if (written >= 0) {
      at += static_cast<std::size_t>(written);
    } else if (errno != EINTR) {
      error = errno;
    }
  }
  // In this order, because a change of the owner clears some bits of the mode.
  if (error == 0 && !is_given(::fchown(descriptor, rights.owner, rights.group))) error = errno;
  if (error == 0 && ::fchmod(descriptor, rights.mode) != 0) error = errno;
  if (error == 0 && ::fsync(descriptor) != 0 && errno != EINVAL && errno != ENOTSUP) error = errno;
  if (::close(descriptor) != 0 && error == 0) error = errno;
  return error;
}

int SourceTree::rename(const fs::path& from, const fs::path& to) const {
  if (const int error = begin(FileOperation::rename, to)) return error;
  return ::rename(from.c_str(), to.c_str()) == 0 ? 0 : errno;
}

int SourceTree::remove(const fs::path& path) const {
  struct stat status {};
  if (::lstat(path.c_str(), &status) != 0) return 0;
  if (const int error = begin(FileOperation::remove, path)) return error;
  return ::unlink(path.c_str()) == 0 || errno == ENOENT ? 0 : errno;
}

int SourceTree::remove_folder_if_empty(const fs::path& folder) const {
  std::error_code error;
  if (!fs::is_empty(folder, error) || error) return 0;  // it holds other files, or is already gone
  if (const int refused = begin(FileOperation::remove_folder, folder)) return refused;
  return ::rmdir(folder.c_str()) == 0 || errno == ENOTEMPTY || errno == EEXIST || errno == ENOENT ? 0 : errno;
}

void SourceTree::commit(const Transaction& transaction) const {
  struct Step {
    fs::path path;
    std::optional<std::string> old_content;  // nullopt: the file does not exist
  };
  std::vector<Step> steps;
  for (const FileChange& change : transaction.changes) {
    const std::optional<std::string> old_content = read(change.file);
    old_content ? require_writable(change.file) : require_free(change.file);
    const fs::path path = resolve(change.file);
    for (const Step& step : steps) require(step.path != path, change.file + ": two names refer to the same file");
    steps.push_back({path, old_content});
  }
  const fs::path record = resolve(transaction.record);
  const fs::path folder = record.parent_path();
  const std::optional<std::string> old_record = read(transaction.record);
  if (!old_record) require_free(transaction.record);

  std::vector<fs::path> staged;   // including partly written ones
  std::vector<fs::path> folders;  // that were created
  const auto stage = [&](const fs::path& path, const char* ending, const std::string& content) {
    staged.push_back(beside(path, ending));
    if (const int error = write(staged.back(), content, path)) fail(path, error);
  };
  const auto put = [&](const fs::path& path, const char* ending) {
    if (const int error = rename(beside(path, ending), path)) fail(path, error);
  };
  bool recorded = false;
  std::size_t renamed = 0;
  /// Rolls back. @return whether the tree is as it was before
  const auto go_back = [&] {
    bool whole = true;
    for (std::size_t i = 0; i < renamed; ++i) {
      const fs::path& path = steps[i].path;
      whole = (steps[i].old_content ? rename(beside(path, kOld), path) : remove(path)) == 0 && whole;
    }
    if (!whole) return false;  // keep the record, so that revert can finish
    // Remove the record last, so that any remaining staged file is covered by one.
    const fs::path old_record_file = beside(record, kOld);
    for (const fs::path& path : staged) {
      if (path != old_record_file || !recorded) whole = remove(path) == 0 && whole;
    }
    for (const fs::path& made : folders) whole = remove_folder_if_empty(made) == 0 && whole;
    if (!whole) return false;
    if (recorded) whole = old_record ? rename(old_record_file, record) == 0 : remove(record) == 0;
    return whole && remove_folder_if_empty(folder) == 0;
  };
  try {
    if (const int error = make_folder(folder); error != 0 && error != EEXIST) fail(folder, error);
    if (old_record) stage(record, kOld, *old_record);
    stage(record, kNew, transaction.under_way);
    put(record, kNew);
    recorded = true;
    sync_folder(folder);
    sync_folder(folder.parent_path());
    for (std::size_t i = 0; i < steps.size(); ++i) {
      const fs::path parent = steps[i].path.parent_path();
      if (std::error_code error; !fs::exists(parent, error)) {
        folders.push_back(parent);
        if (const int refused = make_folder(parent)) fail(parent, refused);
      }
      if (steps[i].old_content) stage(steps[i].path, kOld, *steps[i].old_content);
      if (transaction.changes[i].content) stage(steps[i].path, kNew, *transaction.changes[i].content);
    }
    if (transaction.afterwards) stage(record, kNew, *transaction.afterwards);
    for (; renamed < steps.size(); ++renamed) {
      const fs::path& path = steps[renamed].path;
      if (transaction.changes[renamed].content) {
        put(path, kNew);
      } else if (const int error = remove(path)) {
        fail(path, error);
      }
    }
    for (const Step& step : steps) sync_folder(step.path.parent_path());
    if (transaction.afterwards) put(record, kNew);
  } catch (const std::exception& error) {
    if (go_back()) throw;
    throw WriteError(std::string(error.what()) +
                     "; undoing the first changes failed too: splatboost patch revert PATH repairs the tree");
  }
  // All new content is in place; the rest is cleanup.
  for (const fs::path& path : staged) {
    if (const int error = remove(path)) {
      throw WriteError(path.string() + ": cannot be removed: " + std::strerror(error) +
                       "; everything else is done, the same command again removes it");
    }
  }
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const fs::path parent = steps[i].path.parent_path();
    if (transaction.changes[i].content || parent == root_) continue;
    if (const int error = remove_folder_if_empty(parent)) {
      throw WriteError(parent.string() + ": cannot be removed: " + std::strerror(error) +
                       "; everything else is done, the same command again removes it");
    }
  }
  if (!transaction.afterwards) remove_record(transaction.record);
  sync_folder(folder);
}

void SourceTree::remove_record(const std::string& record) const {
  const fs::path path = resolve(record);
  int error = remove(path);
  if (error == 0) error = remove_folder_if_empty(path.parent_path());
  if (error != 0) {
    throw WriteError(record + ": cannot be removed: " + std::strerror(error) +
                     "; everything else is done, the same command again removes it");
  }
  sync_folder(path.parent_path().parent_path());
}

std::vector<std::string> SourceTree::leftovers(const std::vector<std::string>& files, const std::string& record) const {
  std::vector<std::string> names;
  const auto look_beside = [&](const std::string& file) {
    for (const char* ending : {kNew, kOld}) {
      std::error_code error;
      const fs::path path = beside(resolve(file), ending);
      if (fs::exists(fs::symlink_status(path, error))) names.push_back(path.lexically_relative(root_).string());
    }
  };
  for (const std::string& file : files) look_beside(file);
  look_beside(record);
  std::set<fs::path> folders{resolve(record).parent_path()};
  for (const std::string& file : files) folders.insert(resolve(file).parent_path());
  for (const fs::path& folder : folders) {
    std::error_code error;
    const auto inside = std::distance(fs::directory_iterator(folder, error), fs::directory_iterator());
    if (!error && inside == std::count_if(names.begin(), names.end(), [&](const std::string& name) {
                    return (root_ / name).parent_path() == folder;
                  })) {
      names.push_back(folder.lexically_relative(root_).string());
    }
  }
  return names;
}

void SourceTree::remove_leftovers(const std::vector<std::string>& leftovers) const {
  for (const std::string& name : leftovers) {
    const fs::path path = root_ / name;
    if (const int error = fs::is_directory(path) ? remove_folder_if_empty(path) : remove(path)) {
      throw WriteError(name + ": cannot be removed: " + std::strerror(error) +
                       "; an interrupted command left it, splatboost patch revert PATH removes it");
    }
  }
}

}  // namespace splatboost::patch

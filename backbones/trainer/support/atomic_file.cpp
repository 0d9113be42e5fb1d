// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/atomic_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <ostream>
#include <stdexcept>
#include <streambuf>
#include <string_view>
#include <utility>
#include <vector>

#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& cause) {
  throw std::runtime_error(path.string() + ": cannot be written: " + cause);
}

/// Reports that no file can be created beside `path`. A wrong place is the user's to correct; a full disk is a failure.
[[noreturn]] void fail_to_create(const std::filesystem::path& path, int error) {
  for (const int of_the_place : {ENOENT, ENOTDIR, EACCES, EPERM, EROFS}) {
    require(error != of_the_place, path.string() + ": cannot be written: " + std::strerror(error) +
                                       "; name a file in an existing folder that you may write to");
  }
  fail(path, std::strerror(error));
}

// Not derived from the target's name, which may already have the maximum length of the file system.
constexpr std::string_view kTemporaryPrefix = ".splatboost-";
constexpr std::string_view kTemporarySuffix = ".tmp";
constexpr char kLockName[] = ".splatboost.lock";

/// Whether the path still refers to the open file.
bool is_at(int descriptor, const std::filesystem::path& path) {
  struct stat opened {};
  struct stat named {};
  return ::fstat(descriptor, &opened) == 0 && ::stat(path.c_str(), &named) == 0 && opened.st_ino == named.st_ino &&
         opened.st_dev == named.st_dev;
}

/// A stream buffer for a file descriptor. std::ofstream loses errno, and with it the cause ("No space left on device"),
/// and offers no fsync.
class DescriptorBuffer final : public std::streambuf {
 public:
  explicit DescriptorBuffer(int descriptor) : descriptor_(descriptor), buffer_(1 << 18) {
    setp(buffer_.data(), buffer_.data() + buffer_.size());
  }

  int error() const { return error_; }

 protected:
  int_type overflow(int_type character) override {
    if (sync() != 0) return traits_type::eof();
    if (!traits_type::eq_int_type(character, traits_type::eof())) {
      *pptr() = traits_type::to_char_type(character);
      pbump(1);
    }
    return traits_type::not_eof(character);
  }

  int sync() override {
    const char* begin = pbase();
    const char* const end = pptr();
    while (begin < end && error_ == 0) {
      const ssize_t written = ::write(descriptor_, begin, static_cast<std::size_t>(end - begin));
      if (written < 0) {
        if (errno == EINTR) continue;
        error_ = errno;
      } else {
        begin += written;
      }
    }
    setp(buffer_.data(), buffer_.data() + buffer_.size());
    return error_ == 0 ? 0 : -1;
  }

 private:
  int descriptor_;
  int error_ = 0;
  std::vector<char> buffer_;
};

}  // namespace

TemporaryFile::TemporaryFile(const std::filesystem::path& target, std::string_view ending) {
  static std::atomic<unsigned> counter{0};
  const std::string prefix = std::string(kTemporaryPrefix) + std::to_string(::getpid()) + "-";
  const std::string suffix = std::string(kTemporarySuffix) + std::string(ending);
  for (;;) {
    path = target.parent_path() / (prefix + std::to_string(counter++) + suffix);
    descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (descriptor < 0 && errno == EEXIST) continue;  // left by a killed process with the same process ID
    if (descriptor < 0) fail_to_create(target, errno);
    // The lock marks the file as in use. remove_stale_files() may have removed it before it was locked.
    if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0 || is_at(descriptor, path)) return;
    ::close(descriptor);
  }
}

TemporaryFile::~TemporaryFile() {
  if (descriptor >= 0) ::close(descriptor);
  if (!renamed) ::unlink(path.c_str());
}

std::filesystem::path file_to_replace(const std::filesystem::path& path) {
  std::error_code ignored;
  const std::filesystem::path target =
      std::filesystem::is_symlink(path, ignored) ? std::filesystem::weakly_canonical(path, ignored) : path;
  require(!target.empty(), path.string() + ": cannot be written: the name is empty or a broken symbolic link");
  require(!std::filesystem::is_directory(target, ignored),
          path.string() + ": cannot be written: it is a folder; name a file");
  // The rename would replace it; links such as /dev/stdout, which have no canonical path, are followed.
  require(!std::filesystem::is_other(path, ignored), path.string() + ": is a device or a pipe; name a file");
  return target;
}

void require_writable(const std::filesystem::path& path) { const TemporaryFile removed(file_to_replace(path)); }

void require_writable_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::path existing = std::filesystem::absolute(folder, error);
  while (!std::filesystem::exists(existing, error) && existing.has_relative_path()) existing = existing.parent_path();
  require(std::filesystem::is_directory(existing, error), existing.string() + ": is not a folder; name another one");
  const bool writable = ::access(existing.c_str(), W_OK | X_OK) == 0;
  const int reason = errno;  // before the message is made, which may change it
  require(writable, existing.string() + ": cannot be written to: " + std::strerror(reason));
}

void require_replaceable(const std::filesystem::path& output, const std::vector<std::filesystem::path>& inputs) {
  std::error_code ignored;
  for (const std::filesystem::path& input : inputs) {
    require(!std::filesystem::equivalent(output, input, ignored),
            output.string() + ": is an input of this command, which it would replace; name another file to write");
  }
  // Absolute first: of a relative path that does not exist, weakly_canonical() does not add the current folder.
  const std::filesystem::path target =
      std::filesystem::weakly_canonical(std::filesystem::absolute(output, ignored), ignored);
  for (auto folder = target.parent_path(); folder.has_relative_path(); folder = folder.parent_path()) {
    const std::filesystem::path run = folder.parent_path();
    require(folder.filename() != "point_cloud" || !std::filesystem::exists(run / "config.json", ignored),
            output.string() + ": is in the folder of saved models of " + run.string() + "; name a file elsewhere");
  }
}

void write_file_atomically(const std::filesystem::path& path, const std::function<void(std::ostream&)>& write) {
  const std::filesystem::path target = file_to_replace(path);
  TemporaryFile temporary(target);
  const int descriptor = temporary.descriptor;

  // A file that is replaced keeps its permissions.
  struct stat old_status {};
  if (::stat(target.c_str(), &old_status) == 0) (void)::fchmod(descriptor, old_status.st_mode & 07777);

  DescriptorBuffer buffer(descriptor);
  std::ostream stream(&buffer);
  try {
    write(stream);
  } catch (...) {
    if (buffer.error() != 0) fail(path, std::strerror(buffer.error()));
    throw;
  }
  stream.flush();
  if (buffer.error() != 0) fail(path, std::strerror(buffer.error()));
  if (!stream) fail(path, "its content could not be produced");
  // The data must be on disk before the rename, or a power failure could leave an empty file under the old name.
  if (::fsync(descriptor) != 0 && errno != EINVAL && errno != ENOTSUP) fail(path, std::strerror(errno));
  temporary.descriptor = -1;
  if (::close(descriptor) != 0) fail(path, std::strerror(errno));
  if (::rename(temporary.path.c_str(), target.c_str()) != 0) fail(path, std::strerror(errno));
  temporary.renamed = true;
}

void write_text_atomically(const std::filesystem::path& path, const std::string& text) {
  write_file_atomically(path,
                        [&](std::ostream& out) { out.write(text.data(), static_cast<std::streamsize>(text.size())); });
}

void write_second_file(const std::filesystem::path& first, const std::function<void()>& write) {
  try {
    write();
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(first, ignored);
    throw;
  }
}

void require_second_file(const std::filesystem::path& file) {
  require(is_file(file), file.string() + ": missing, so the model is incomplete; copy the whole folder " +
                             file.parent_path().filename().string() + " of the run, or train again");
}

bool is_working_file(const std::filesystem::path& name) {
  const std::string text = name.filename().string();
  const std::filesystem::path stem = name.stem();  // what is before the ending of a TemporaryFile
  return text == kLockName || (text.starts_with(kTemporaryPrefix) &&
                               (text.ends_with(kTemporarySuffix) || stem.extension() == kTemporarySuffix));
}

void remove_stale_files(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> found;
  std::error_code ignored;
  for (std::filesystem::directory_iterator entry(folder, ignored), end; !ignored && entry != end;
       entry.increment(ignored)) {
    if (is_working_file(entry->path()) && entry->path().filename() != kLockName) found.push_back(entry->path());
  }
  for (const std::filesystem::path& path : found) {
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (descriptor < 0) continue;
    if (::flock(descriptor, LOCK_EX | LOCK_NB) == 0) ::unlink(path.c_str());
    ::close(descriptor);
  }
}

bool is_file(const std::filesystem::path& path) {
  std::error_code error;
  const bool regular = std::filesystem::is_regular_file(path, error);
  require(error != std::errc::permission_denied, path.string() + ": cannot be read: " + error.message());
  return regular;
}

void make_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw std::runtime_error(folder.string() + ": cannot create this folder: " + error.message());
  remove_stale_files(folder);
}

FolderLock::FolderLock(const std::filesystem::path& folder) : file_(folder / kLockName) {
  for (;;) {
    descriptor_ = ::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor_ < 0) {
      throw InputError(folder.string() + ": cannot be written to: " + std::strerror(errno));
    }
    if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
      ::close(descriptor_);
      throw InputError(folder.string() +
                       ": another splatboost process is using this folder; wait until it ends, or name another folder");
    }
    // The previous holder may have removed the file after it was opened here; then this lock has no effect.
    if (is_at(descriptor_, file_)) return;
    ::close(descriptor_);
  }
}

FolderLock::~FolderLock() {
  if (descriptor_ < 0) return;
  ::unlink(file_.c_str());  // while locked: afterwards another process may own the file
  ::close(descriptor_);
}

FolderLock::FolderLock(FolderLock&& other) noexcept
    : file_(std::move(other.file_)), descriptor_(std::exchange(other.descriptor_, -1)) {}

FolderLock& FolderLock::operator=(FolderLock&& other) noexcept {
  std::swap(file_, other.file_);
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

}  // namespace splatboost

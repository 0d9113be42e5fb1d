// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <ostream>
#include <stdexcept>
#include <streambuf>
#include <vector>

namespace splatboost {
namespace {

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& cause) {
  throw std::runtime_error(path.string() + ": cannot be written: " + cause);
}

/// A stream onto a file descriptor. std::ofstream would lose errno, hence the cause ("No space left on device"),
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

/// The file beside the target: closed and removed unless it was renamed.
struct TemporaryFile {
  std::filesystem::path path;
  int descriptor = -1;
  bool renamed = false;

  ~TemporaryFile() {
    if (descriptor >= 0) ::close(descriptor);
    if (!renamed) ::unlink(path.c_str());
  }
};

}  // namespace

void write_file_atomically(const std::filesystem::path& path, const std::function<void(std::ostream&)>& write) {
  // Through a symbolic link the file it points to is replaced, not the link.
  std::error_code ignored;
  const std::filesystem::path target =
      std::filesystem::is_symlink(path, ignored) ? std::filesystem::weakly_canonical(path, ignored) : path;
  if (target.empty()) fail(path, "the name is empty or a link that leads nowhere");
  if (std::filesystem::is_directory(target, ignored)) fail(path, "it is a folder");

  // Unique among the processes and threads that may write the same file at once.
  static std::atomic<unsigned> counter{0};
  TemporaryFile temporary;
  std::filesystem::path beside = target;
  beside += ".tmp-" + std::to_string(::getpid()) + "-" + std::to_string(counter++);
  const int descriptor = ::open(beside.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor < 0) fail(path, std::strerror(errno));
  temporary.path = beside;
  temporary.descriptor = descriptor;

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
  // The bytes must be on disk before the name is, or a power cut could leave an empty file under the old name.
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

}  // namespace splatboost

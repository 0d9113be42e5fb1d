// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <filesystem>
#include <ostream>
#include <stdexcept>
#include <string>

#include "support/temporary_folder.h"

namespace splatboost::test {
namespace {

/// Lets no file grow beyond a size, as a full disk would.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : old_handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &old_limit_);
    const rlimit limit{bytes, old_limit_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &old_limit_);
    std::signal(SIGXFSZ, old_handler_);
  }

 private:
  rlimit old_limit_{};
  void (*old_handler_)(int);
};

std::string failure_of(const std::filesystem::path& path, const std::string& text) {
  try {
    write_text_atomically(path, text);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  ADD_FAILURE() << "nothing was thrown";
  return "";
}

TEST(AtomicFile, WritesAllBytesAndLeavesNothingElse) {
  const TemporaryFolder folder;
  std::string content(3'000'001, 'x');
  for (std::size_t i = 0; i < content.size(); ++i) content[i] = static_cast<char>(i * 31 >> 3);
  write_file_atomically(folder / "a.bin", [&](std::ostream& out) {
    for (std::size_t i = 0; i < content.size(); i += 1000) out << content.substr(i, 1000);
  });
  EXPECT_TRUE(read_file(folder / "a.bin") == content);
  write_text_atomically(folder / "a.bin", "short");
  EXPECT_EQ(read_file(folder / "a.bin"), "short");
  EXPECT_EQ(files_in(folder.path()), 1u);
}

TEST(AtomicFile, FullDiskKeepsTheOldFile) {
  const TemporaryFolder folder;
  write_text_atomically(folder / "model.ply", "old");
  std::string message;
  {
    const FileSizeLimit limit(100'000);
    message = failure_of(folder / "model.ply", std::string(5'000'000, 'y'));
  }
  expect_contains(message, "model.ply");
  expect_contains(message, "File too large");
  EXPECT_EQ(read_file(folder / "model.ply"), "old");
  EXPECT_EQ(files_in(folder.path()), 1u);
}

TEST(AtomicFile, FullDiskIsNoticedInTheLastBytes) {
  // Less than a buffer: only the flush at the end can fail.
  const TemporaryFolder folder;
  std::string message;
  {
    const FileSizeLimit limit(10);
    message = failure_of(folder / "small.json", "0123456789abcdef");
  }
  expect_contains(message, "small.json");
  EXPECT_EQ(files_in(folder.path()), 0u);
}

TEST(AtomicFile, AnExceptionOfTheWriterKeepsTheOldFile) {
  const TemporaryFolder folder;
  write_text_atomically(folder / "a", "old");
  EXPECT_THROW(write_file_atomically(folder / "a",
                                     [](std::ostream& out) {
                                       out << "half";
                                       throw std::logic_error("no");
                                     }),
               std::logic_error);
  EXPECT_EQ(read_file(folder / "a"), "old");
  EXPECT_EQ(files_in(folder.path()), 1u);
}

TEST(AtomicFile, NamesPathAndCause) {
  const TemporaryFolder folder;
  expect_contains(failure_of(folder / "missing/a.txt", "x"), "missing/a.txt: cannot be written: No such file");
  std::filesystem::create_directory(folder / "d");
  expect_contains(failure_of(folder / "d", "x"), "is a folder");
  EXPECT_EQ(files_in(folder.path()), 1u);
}

TEST(AtomicFile, KeepsPermissionsAndLinks) {
  const TemporaryFolder folder;
  write_text_atomically(folder / "target", "old");
  std::filesystem::permissions(folder / "target", std::filesystem::perms(0640));
  std::filesystem::create_symlink("target", folder / "link");
  write_text_atomically(folder / "link", "new");
  EXPECT_TRUE(std::filesystem::is_symlink(folder / "link"));
  EXPECT_EQ(read_file(folder / "target"), "new");
  EXPECT_EQ(std::filesystem::status(folder / "target").permissions(), std::filesystem::perms(0640));
}

}  // namespace
}  // namespace splatboost::test

// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <ostream>
#include <stdexcept>
#include <string>
#include <utility>

#include "support/temporary_folder.h"

namespace splatboost::test {
namespace {

/// Limits the size of files, to simulate a full disk.
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
  // Less data than a buffer holds: only the flush at the end can fail.
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

TEST(AtomicFile, RequireWritableChangesNothing) {
  const TemporaryFolder folder;
  require_writable(folder / "new");
  EXPECT_EQ(files_in(folder.path()), 0u);
  write_text_atomically(folder / "old", "old");
  require_writable(folder / "old");
  EXPECT_EQ(read_file(folder / "old"), "old");
  EXPECT_EQ(files_in(folder.path()), 1u);
}

TEST(AtomicFile, AWrongPlaceIsBadInput) {
  const TemporaryFolder folder;
  write_file(folder / "file", "x");
  for (const char* name : {"missing/a.txt", "file/a.txt"}) {
    expect_contains(input_error_of([&] { require_writable(folder / name); }), "name a file in an existing folder");
  }
  expect_contains(input_error_of([&] { require_writable(folder.path()); }), "it is a folder");
}

TEST(AtomicFile, InputsAndSavedModelsAreNotReplaced) {
  const TemporaryFolder folder;
  write_file(folder / "in.ply", "in");
  write_file(folder / "run/point_cloud/iteration_9/point_cloud.ply", "model");
  write_file(folder / "points/point_cloud/a.ply", "of no run");
  write_file(folder / "run/config.json", "{}");
  std::filesystem::create_symlink("in.ply", folder / "link.ply");
  const auto refusal = [&](const char* output) {
    return input_error_of([&] { require_replaceable(folder / output, {"", folder / "none.ply", folder / "in.ply"}); });
  };
  for (const char* name : {"in.ply", "link.ply", "run/../in.ply"}) {
    expect_contains(refusal(name), "is an input of this command");
  }
  for (const char* name : {"run/point_cloud/iteration_9/point_cloud.ply", "run/point_cloud/new/a.ply"}) {
    expect_contains(refusal(name), "saved models of");
  }
  for (const char* name : {"out.ply", "run/mesh.ply", "points/point_cloud/a.ply", "missing/out.ply"}) {
    require_replaceable(folder / name, {"", folder / "none.ply", folder / "in.ply"});
  }
}

TEST(AtomicFile, AFileOfALibraryKeepsItsEndingAndIsKnown) {
  const TemporaryFolder folder;
  write_file(folder / ".splatboost-99999-0.tmp.mp4", "left by a killed process");
  write_file(folder / ".splatboost-notes.mp4", "of the user");
  {
    const TemporaryFile file(folder / "turn.mp4", ".mp4");
    EXPECT_EQ(file.path.extension(), ".mp4");
    EXPECT_TRUE(is_working_file(file.path));
    remove_stale_files(folder.path());
    EXPECT_TRUE(std::filesystem::exists(file.path));
    EXPECT_EQ(files_in(folder.path()), 2u);
  }
  EXPECT_EQ(files_in(folder.path()), 1u);
  EXPECT_FALSE(is_working_file(".splatboost-notes.mp4"));
}

TEST(AtomicFile, KeepsDevicesAndPipes) {
  const TemporaryFolder folder;
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
  std::filesystem::create_symlink("pipe", folder / "link");
  for (const char* name : {"pipe", "link"}) {
    expect_contains(input_error_of([&] { write_text_atomically(folder / name, "x"); }), "is a device or a pipe");
    EXPECT_TRUE(std::filesystem::is_fifo(folder / name));
  }
  EXPECT_EQ(files_in(folder.path()), 2u);
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

TEST(AtomicFile, TakesAsLongANameAsTheFileSystem) {
  const TemporaryFolder folder;
  write_text_atomically(folder / std::string(255, 'n'), "new");
  EXPECT_EQ(read_file(folder / std::string(255, 'n')), "new");
}

TEST(AtomicFile, RemovesWhatAKilledProcessLeft) {
  const TemporaryFolder folder;
  write_text_atomically(folder / "kept.json", "kept");
  const pid_t child = fork();
  if (child == 0) {
    try {
      write_file_atomically(folder / "model.ply", [](std::ostream& out) {
        out << "half" << std::flush;
        std::raise(SIGKILL);
      });
    } catch (...) {
    }
    _exit(1);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  ASSERT_EQ(files_in(folder.path()), 2u);
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    EXPECT_EQ(is_working_file(entry.path()), entry.path().filename() != "kept.json");
  }
  // Files that are still being written stay.
  write_file_atomically(folder / "other.ply", [&](std::ostream& out) {
    out << "other";
    EXPECT_EQ(files_in(folder.path()), 3u);
    remove_stale_files(folder.path());
    EXPECT_EQ(files_in(folder.path()), 2u);
  });
  EXPECT_EQ(read_file(folder / "other.ply"), "other");
  EXPECT_EQ(read_file(folder / "kept.json"), "kept");
  EXPECT_EQ(files_in(folder.path()), 2u);
}

TEST(AtomicFile, AFileLeftByAProcessOfTheSameNumberIsNotInTheWay) {
  const TemporaryFolder folder;
  for (int i = 0; i < 200; ++i) {
    write_file(folder / (".splatboost-" + std::to_string(getpid()) + "-" + std::to_string(i) + ".tmp"), "left");
  }
  write_text_atomically(folder / "a", "new");
  EXPECT_EQ(read_file(folder / "a"), "new");
}

TEST(FolderLock, HasOneHolder) {
  const TemporaryFolder folder;
  {
    const FolderLock lock(folder.path());
    expect_contains(input_error_of([&] { FolderLock second(folder.path()); }),
                    "another splatboost process is using this folder");
    EXPECT_TRUE(is_working_file(folder / ".splatboost.lock"));
  }
  EXPECT_EQ(files_in(folder.path()), 0u);
  FolderLock first(folder.path());
  FolderLock moved = std::move(first);
  input_error_of([&] { FolderLock second(folder.path()); });
}

TEST(FolderLock, EndsWithTheProcess) {
  const TemporaryFolder folder;
  const pid_t child = fork();
  if (child == 0) {
    const FolderLock lock(folder.path());
    std::raise(SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(files_in(folder.path()), 1u);
  const FolderLock lock(folder.path());
}

TEST(AtomicFile, TheFirstFileOfAPairDoesNotStayAlone) {
  const TemporaryFolder folder;
  write_file(folder / "first", "a");
  write_second_file(folder / "first", [&] { write_file(folder / "second", "b"); });
  EXPECT_EQ(files_in(folder.path()), 2u);
  EXPECT_THROW(write_second_file(folder / "first", [] { throw std::runtime_error("disk full"); }), std::runtime_error);
  EXPECT_FALSE(std::filesystem::exists(folder / "first"));
  require_second_file(folder / "second");
  expect_contains(input_error_of([&] { require_second_file(folder / "third"); }),
                  "third: missing, so the model is incomplete");
}

}  // namespace
}  // namespace splatboost::test

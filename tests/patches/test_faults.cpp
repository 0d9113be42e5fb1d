// SPDX-License-Identifier: Apache-2.0
/// @file Disk errors and power cuts at each operation of apply and revert in turn.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "miniature.h"
#include "tool/patch.h"

namespace splatboost::patch::test {
namespace {

constexpr int kMaxOperations = 200;  // more operations than any command here makes
constexpr int kCut = 9;

enum class Fault {
  once,       ///< one operation fails
  full_disk,  ///< from one operation on, all that need space fail
  dead_disk,  ///< from one operation on, all fail
  power_cut   ///< the process ends before one operation
};
constexpr Fault kFaults[] = {Fault::once, Fault::full_disk, Fault::dead_disk, Fault::power_cut};
constexpr const char* kNames[] = {"once", "full disk", "dead disk", "power cut"};

/// The tests sync hundreds of trees to disk; they use a folder in memory where there is one.
class Faults : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (::access("/dev/shm", W_OK) == 0) ::setenv("TMPDIR", "/dev/shm", 0);
  }
};

bool needs_space(FileOperation operation) {
  return operation == FileOperation::make_folder || operation == FileOperation::create ||
         operation == FileOperation::write;
}

/// Makes the n-th operation fail. @param hit set to true if the fault was injected
FileHook hook_of(Fault fault, int n, bool& hit) {
  return [fault, n, &hit, i = 0](FileOperation operation, const std::filesystem::path&) mutable {
    const int now = i++;
    if (now < n || (fault == Fault::once && now > n)) return 0;
    if (fault == Fault::full_disk) {
      hit = hit || needs_space(operation);
      return needs_space(operation) ? ENOSPC : 0;
    }
    hit = true;
    if (fault == Fault::power_cut) _exit(kCut);
    return EIO;
  };
}

Outcome apply_to(const Miniature& mini, FileHook hook = {}) {
  return apply(mini.recipe(), SourceTree(mini.tree(), std::move(hook)), Writing::write);
}
Outcome revert_of(const Miniature& mini, FileHook hook = {}) {
  return revert(SourceTree(mini.tree(), std::move(hook)), Writing::write);
}

/// Runs command(hook). @param said its error message, unchanged on success @return whether the fault was injected
template <class Command>
bool strike(Fault fault, int n, std::string& said, Command&& command) {
  bool hit = false;
  const auto run = [&] {
    try {
      command(hook_of(fault, n, hit));
    } catch (const WriteError& error) {
      said = error.what();
      EXPECT_EQ(said.find('\n'), std::string::npos) << said;
      EXPECT_NE(said.find(": "), std::string::npos) << said;
    }
  };
  if (fault != Fault::power_cut) {
    run();
    return hit;
  }
  const pid_t child = fork();
  if (child == 0) {
    run();
    _exit(0);
  }
  int status = 0;
  EXPECT_EQ(waitpid(child, &status, 0), child);
  return WEXITSTATUS(status) == kCut;
}

std::size_t files_in(const std::filesystem::path& folder) {
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) files += entry.is_regular_file();
  return files;
}

/// A recipe that edits files and adds one.
struct Brings : Miniature {
  Brings() { bring_a_file(); }
};

bool is_pristine(const Miniature& mini) {
  return mini.train() == kTrain && mini.model() == kModel && files_in(mini.tree()) == 2 && !mini.has_manifest() &&
         !std::filesystem::exists(mini.brought().parent_path());
}

/// Whether the tree is patched and has no other files.
bool is_patched(const Miniature& mini) {
  const std::optional<Manifest> manifest = read_manifest(SourceTree(mini.tree()));
  return manifest && manifest->state == State::applied && mini.train() == kPatchedTrain &&
         mini.model() == kPatchedModel && read_file(mini.brought()) == kBrought && files_in(mini.tree()) == 5;
}

/// Each file is as before or as after, and an incomplete operation or left-over files are detected.
void expect_whole_and_told(const Miniature& mini) {
  EXPECT_TRUE(mini.train() == kTrain || mini.train() == kPatchedTrain);
  EXPECT_TRUE(mini.model() == kModel || mini.model() == kPatchedModel);
  EXPECT_TRUE(!std::filesystem::exists(mini.brought()) || read_file(mini.brought()) == kBrought);
  if (is_pristine(mini) || is_patched(mini)) return;
  const SourceTree tree(mini.tree());
  const std::optional<Manifest> manifest = read_manifest(tree);
  EXPECT_TRUE((manifest && manifest->state != State::applied) || !leftovers(tree, manifest).empty());
}

TEST_F(Faults, OfApplyLeaveFilesWholeAreToldAndMended) {
  for (const Fault fault : kFaults) {
    int n = 0;
    for (; n < kMaxOperations; ++n) {
      SCOPED_TRACE(std::string(kNames[static_cast<int>(fault)]) + " at " + std::to_string(n));
      const Brings mini;
      std::string said;
      if (!strike(fault, n, said, [&](FileHook hook) { apply_to(mini, std::move(hook)); })) {
        EXPECT_EQ(said, "");
        break;
      }
      expect_whole_and_told(mini);
      if (fault != Fault::power_cut) {
        ASSERT_NE(said, "");
        expect_contains(said, std::strerror(fault == Fault::full_disk ? ENOSPC : EIO));
      }
      // Undoing needs no space.
      EXPECT_TRUE(fault != Fault::full_disk || is_pristine(mini));
      // After one error the command is undone, unless the error occurred in the cleanup after success.
      if (fault == Fault::once && !is_pristine(mini)) {
        const std::optional<Manifest> manifest = read_manifest(SourceTree(mini.tree()));
        ASSERT_TRUE(manifest.has_value());
        EXPECT_TRUE(manifest->state == State::applied) << said;
        expect_contains(said, "the same command again removes it");
        apply_to(mini);
        EXPECT_TRUE(is_patched(mini));
      }
      revert_of(mini);
      EXPECT_TRUE(is_pristine(mini));
      apply_to(mini);
      EXPECT_TRUE(is_patched(mini));
    }
    EXPECT_GT(n, 10);
    EXPECT_LT(n, kMaxOperations);
  }
}

TEST_F(Faults, OfRevertLeaveFilesWholeAreToldAndMended) {
  for (const Fault fault : kFaults) {
    int n = 0;
    for (; n < kMaxOperations; ++n) {
      SCOPED_TRACE(std::string(kNames[static_cast<int>(fault)]) + " at " + std::to_string(n));
      const Brings mini;
      apply_to(mini);
      std::string said;
      if (!strike(fault, n, said, [&](FileHook hook) { revert_of(mini, std::move(hook)); })) {
        EXPECT_EQ(said, "");
        EXPECT_TRUE(is_pristine(mini) || fault == Fault::power_cut);
        break;
      }
      expect_whole_and_told(mini);
      EXPECT_TRUE(fault != Fault::full_disk || is_patched(mini));
      if (fault == Fault::once && !is_patched(mini)) expect_contains(said, "the same command again removes it");
      revert_of(mini);
      EXPECT_TRUE(is_pristine(mini));
    }
    EXPECT_GT(n, 10);
    EXPECT_LT(n, kMaxOperations);
  }
}

TEST_F(Faults, ARevertOfAnInterruptedApplyMayBeInterruptedToo) {
  for (int first = 0; first < kMaxOperations; ++first) {
    for (int second = 0; second < kMaxOperations; ++second) {
      SCOPED_TRACE(std::to_string(first) + ", " + std::to_string(second));
      const Brings mini;
      std::string said;
      if (!strike(Fault::power_cut, first, said, [&](FileHook hook) { apply_to(mini, std::move(hook)); })) return;
      const bool cut = strike(Fault::power_cut, second, said, [&](FileHook hook) { revert_of(mini, std::move(hook)); });
      expect_whole_and_told(mini);
      revert_of(mini);
      ASSERT_TRUE(is_pristine(mini));
      if (!cut) break;
    }
  }
}

TEST_F(Faults, InterruptedCommandsAreNotGoneOnWith) {
  const Brings mini;
  std::string said;
  int renames = 0;
  const pid_t child = fork();
  if (child == 0) {
    apply_to(mini, [&](FileOperation operation, const std::filesystem::path&) {
      if (operation == FileOperation::rename && renames++ == 4)
        _exit(kCut);  // after the record, its .gitignore, boost.h and train.py
      return 0;
    });
    _exit(0);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(mini.train(), kPatchedTrain);
  EXPECT_EQ(mini.model(), kModel);
  expect_contains(error_of([&] { apply_to(mini); }), "interrupted");
  expect_contains(error_of([&] { (void)verify(SourceTree(mini.tree())); }), "splatboost patch revert");
  // The user's later edits stay.
  write_file(mini.tree() / "train.py", "# mine\n" + kPatchedTrain);
  revert_of(mini);
  EXPECT_EQ(mini.train(), "# mine\n" + kTrain);
  EXPECT_EQ(files_in(mini.tree()), 2u);
}

}  // namespace
}  // namespace splatboost::patch::test

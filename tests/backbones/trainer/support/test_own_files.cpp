// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/own_files.h"

#include <gtest/gtest.h>

#include "support/temporary_folder.h"
#include "trainer/support/atomic_file.h"

namespace splatboost::test {
namespace {

constexpr OwnEntry kOwn[] = {{"models", R"(iteration_[0-9]+/(model\.ply|nets\.bin))"}, {"notes.json", {}}};

class OwnFiles : public ::testing::Test {
 protected:
  void put(const char* file) {
    make_folder((folder / file).parent_path());
    write_text_atomically(folder / file, "x");
  }
  TemporaryFolder folder;
};

TEST_F(OwnFiles, AreThoseThatTheExpressionDescribes) {
  EXPECT_FALSE(find_foreign_file(folder.path(), kOwn)) << "none exists";
  put("models/iteration_7/model.ply");
  put("models/iteration_30000/nets.bin");
  put("notes.json");
  put("models/iteration_7/.model.ply.1234");
  put("another.txt");
  EXPECT_FALSE(find_foreign_file(folder.path(), kOwn));
  remove_own_files(folder.path(), kOwn);
  EXPECT_FALSE(std::filesystem::exists(folder / "models"));
  EXPECT_FALSE(std::filesystem::exists(folder / "notes.json"));
  EXPECT_TRUE(std::filesystem::exists(folder / "another.txt"));
}

TEST_F(OwnFiles, AreNotAtAnyOtherPlace) {
  for (const char* file : {"models/iteration_7/mine.ply", "models/iteration_7_backup/model.ply", "models/model.ply",
                           "models/iteration_7/deeper/model.ply", "models/iteration_x/nets.bin", "models/a/.b/c",
                           "models/iteration_7/model.ply2", "models/iteration_7/models_ply", "notes.json/notes.json"}) {
    put("models/iteration_7/model.ply");
    put(file);
    const auto foreign = find_foreign_file(folder.path(), kOwn);
    ASSERT_TRUE(foreign) << file;
    EXPECT_TRUE(*foreign == folder / file || *foreign == folder / "notes.json") << *foreign;
    std::filesystem::remove_all(folder / "models");
    std::filesystem::remove_all(folder / "notes.json");
  }
  put("models");
  EXPECT_EQ(find_foreign_file(folder.path(), kOwn), folder / "models") << "a file instead of a folder";
}

// A saved model may have been moved to another disk, with a link in its place.
TEST_F(OwnFiles, MayBeBehindALinkWhichAloneIsRemoved) {
  put("elsewhere/model.ply");
  make_folder(folder / "models");
  std::filesystem::create_directory_symlink(folder / "elsewhere", folder / "models/iteration_9");
  EXPECT_FALSE(find_foreign_file(folder.path(), kOwn));
  remove_own_files(folder.path(), kOwn);
  EXPECT_TRUE(std::filesystem::exists(folder / "elsewhere/model.ply"));
}

}  // namespace
}  // namespace splatboost::test

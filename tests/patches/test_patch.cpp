// SPDX-License-Identifier: Apache-2.0
#include "tool/patch.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>

#include "miniature.h"

namespace splatboost::patch::test {
namespace {

namespace fs = std::filesystem;

Outcome apply_to(const Miniature& mini) { return apply(mini.recipe(), SourceTree(mini.tree()), Writing::write); }
Outcome revert_of(const Miniature& mini) { return revert(SourceTree(mini.tree()), Writing::write); }

void expect_patched(const Miniature& mini) {
  EXPECT_EQ(mini.train(), kPatchedTrain);
  EXPECT_EQ(mini.model(), kPatchedModel);
}

TEST(Patch, AppliesVerifiesAndReverts) {
  const Miniature mini;
  const Outcome applied = apply_to(mini);
  EXPECT_EQ(applied.layout, "one");
  EXPECT_EQ(applied.files, (std::vector<std::string>{"train.py", "scene/model.py"}));
  expect_patched(mini);
  const Outcome verified = verify(SourceTree(mini.tree()));
  EXPECT_EQ(verified.added, applied.added);
  EXPECT_EQ(verified.removed, applied.removed);
  EXPECT_TRUE(verified.edited_by_user.empty());
  const Outcome reverted = revert_of(mini);
  EXPECT_EQ(reverted.removed, applied.added);
  mini.expect_pristine();
  EXPECT_TRUE(revert_of(mini).nothing_to_do);
}

TEST(Patch, ASecondTimeChangesNothing) {
  const Miniature mini;
  apply_to(mini);
  const auto time = fs::last_write_time(mini.tree() / "train.py");
  EXPECT_TRUE(apply_to(mini).nothing_to_do);
  expect_patched(mini);
  EXPECT_EQ(fs::last_write_time(mini.tree() / "train.py"), time);
}

TEST(Patch, DryRunsOnlyTell) {
  const Miniature mini;
  const Outcome outcome = apply(mini.recipe(), SourceTree(mini.tree()), Writing::dry_run);
  mini.expect_pristine();
  expect_contains(outcome.diff, "+++ b/train.py");
  expect_contains(outcome.diff, "+        boost.begin(iteration)\n");
  apply_to(mini);
  expect_contains(revert(SourceTree(mini.tree()), Writing::dry_run).diff, "-        boost.begin(iteration)\n");
  expect_patched(mini);
}

TEST(Patch, BringsFilesAlongAndTakesThemAway) {
  const Miniature mini;
  mini.bring_a_file();
  EXPECT_EQ(apply_to(mini).files, (std::vector<std::string>{"boost/boost.h", "train.py", "scene/model.py"}));
  EXPECT_EQ(read_file(mini.brought()), kBrought);
  EXPECT_TRUE(apply_to(mini).nothing_to_do);
  expect_contains(verify(SourceTree(mini.tree())).diff, "+// ours\n");
  // A user's file in the added folder stays.
  write_file(mini.tree() / "boost/mine.h", "mine");
  revert_of(mini);
  EXPECT_FALSE(fs::exists(mini.brought()));
  EXPECT_TRUE(fs::remove(mini.tree() / "boost/mine.h"));
  fs::remove(mini.tree() / "boost");
  mini.expect_pristine();
}

TEST(Patch, FilesThatAreBroughtAreNotOverwritten) {
  const Miniature mini;
  mini.bring_a_file();
  write_file(mini.brought(), "mine");
  expect_contains(error_of([&] { apply_to(mini); }), "boost/boost.h: exists already");
  EXPECT_EQ(mini.train(), kTrain);
  fs::remove_all(mini.tree() / "boost");
  apply_to(mini);
  write_file(mini.brought(), "changed");
  EXPECT_EQ(verify(SourceTree(mini.tree())).edited_by_user, std::vector<std::string>{"boost/boost.h"});
  expect_contains(error_of([&] { revert_of(mini); }), "boost/boost.h: belongs to the patch and was changed");
  expect_patched(mini);
  // A different content of the added file is a different version of the recipe.
  write_file(mini.folder / "recipes/mini/boost.h", "// newer\n");
  expect_contains(error_of([&] { apply_to(mini); }), "another version of mini");
  // An added file that the user has deleted is no error.
  fs::remove(mini.brought());
  expect_contains(error_of([&] { (void)verify(SourceTree(mini.tree())); }),
                  "boost/boost.h: belongs to the patch and is missing: run splatboost patch revert");
  revert_of(mini);
  mini.expect_pristine();
}

TEST(Patch, EditsElsewhereStay) {
  const Miniature mini;
  const std::string mine = replaced(kTrain, "loss = model.loss()", "loss = 2 * model.loss()");
  write_file(mini.tree() / "train.py", mine);
  apply_to(mini);
  EXPECT_EQ(mini.train(), replaced(kPatchedTrain, "loss = model.loss()", "loss = 2 * model.loss()"));
  // Further edits after the patch.
  write_file(mini.tree() / "train.py", "# mine\n" + mini.train() + "print('end')\n");
  EXPECT_EQ(verify(SourceTree(mini.tree())).edited_by_user, std::vector<std::string>{"train.py"});
  EXPECT_TRUE(apply_to(mini).nothing_to_do);
  EXPECT_EQ(revert_of(mini).edited_by_user, std::vector<std::string>{"train.py"});
  EXPECT_EQ(mini.train(), "# mine\n" + mine + "print('end')\n");
  EXPECT_EQ(mini.model(), kModel);
}

TEST(Patch, AFileChangedWhereWeEditStopsAll) {
  const Miniature mini;
  write_file(mini.tree() / "scene/model.py", replaced(kModel, "self.denominator += 1", "pass"));
  const std::string line = error_of([&] { apply_to(mini); });
  expect_contains(line, "scene/model.py: 'self.denominator += 1' is missing");
  EXPECT_EQ(mini.train(), kTrain);
  EXPECT_FALSE(mini.has_manifest());
}

TEST(Patch, ChangedSnippetsStopARevertOfAll) {
  const Miniature mini;
  apply_to(mini);
  write_file(mini.tree() / "scene/model.py", replaced(kPatchedModel, "hooks.count(self)", "hooks.count(self, 2)"));
  expect_contains(error_of([&] { revert_of(mini); }),
                  "scene/model.py: the patch's 'hooks.count(self)' was removed or changed");
  expect_contains(error_of([&] { (void)verify(SourceTree(mini.tree())); }), "scene/model.py");
  EXPECT_EQ(mini.train(), kPatchedTrain);
}

TEST(Patch, RestoredFilesAreToldAndRevertGoesOn) {
  const Miniature mini;
  apply_to(mini);
  write_file(mini.tree() / "train.py", kTrain);
  expect_contains(error_of([&] { (void)verify(SourceTree(mini.tree())); }),
                  "train.py: is the same as before the patch");
  revert_of(mini);
  mini.expect_pristine();
}

TEST(Patch, FilesRestoredToAnotherVersionAreKept) {
  const Miniature mini;
  write_file(mini.tree() / "train.py", "# my changes\n" + kTrain);
  apply_to(mini);
  // git checkout also discards what the user had changed before the patch.
  write_file(mini.tree() / "train.py", kTrain);
  expect_contains(error_of([&] { (void)verify(SourceTree(mini.tree())); }),
                  "train.py: contains nothing of the patch: run splatboost patch revert PATH, then apply again");
  expect_contains(error_of([&] { apply_to(mini); }), "train.py: contains nothing of the patch");
  EXPECT_EQ(revert_of(mini).edited_by_user, std::vector<std::string>{"train.py"});
  mini.expect_pristine();
  apply_to(mini);
  expect_patched(mini);
}

/// The names in the inserted line do not show whether it is there, since the host's file has them anyway.
TEST(Patch, FilesRestoredFromALineOfTheirOwnNamesAreKept) {
  const Miniature mini;
  mini.write_recipe(replaced(kRecipe, "hooks.count(self)", "self.denominator = loss"));
  write_file(mini.tree() / "scene/model.py", "# my changes\n" + kModel);
  apply_to(mini);
  write_file(mini.tree() / "scene/model.py", replaced(mini.model(), "denominator = loss", "denominator = 2 * loss"));
  expect_contains(error_of([&] { revert_of(mini); }),
                  "scene/model.py: the patch's 'self.denominator = loss' was removed or changed");
  EXPECT_TRUE(mini.has_manifest());
  write_file(mini.tree() / "scene/model.py", kModel);
  expect_contains(error_of([&] { (void)verify(SourceTree(mini.tree())); }),
                  "scene/model.py: contains nothing of the patch: run splatboost patch revert PATH, then apply again");
  EXPECT_EQ(revert_of(mini).edited_by_user, std::vector<std::string>{"scene/model.py"});
  mini.expect_pristine();
}

TEST(Patch, LostManifestsAreNoticed) {
  const Miniature mini;
  apply_to(mini);
  fs::remove_all(mini.tree() / ".splatboost");
  expect_contains(error_of([&] { apply_to(mini); }), "train.py");
  expect_patched(mini);
  EXPECT_FALSE(mini.has_manifest());
}

TEST(Patch, DamagedManifestsAreTold) {
  const Miniature mini;
  apply_to(mini);
  for (const char* text : {"", "{", "[]", "{\"format\": 1}", "{\"format\": 7}", "{\"format\": \"x\"}"}) {
    write_file(mini.tree() / ".splatboost/patch.json", text);
    expect_contains(error_of([&] { revert_of(mini); }), "patch.json: is damaged");
  }
  expect_patched(mini);
}

TEST(Patch, AnotherRecipeOrVersionWaitsForARevert) {
  const Miniature mini;
  apply_to(mini);
  mini.write_recipe(replaced(kRecipe, "Miniature", "Miniature 2"));
  expect_contains(error_of([&] { apply_to(mini); }), "another version of mini: revert that first");
  revert_of(mini);
  apply_to(mini);
  expect_patched(mini);
}

TEST(Patch, CarriageReturnsStay) {
  const Miniature mini;
  std::string dos;
  for (const char c : kTrain) dos += c == '\n' ? std::string("\r\n") : std::string(1, c);
  write_file(mini.tree() / "train.py", dos);
  apply_to(mini);
  std::string patched;
  for (const char c : kPatchedTrain) patched += c == '\n' ? std::string("\r\n") : std::string(1, c);
  EXPECT_EQ(mini.train(), patched);
  revert_of(mini);
  EXPECT_EQ(mini.train(), dos);
}

/// The record is JSON and holds only UTF-8.
TEST(Patch, ReplacedCommentsThatAreNotUtf8AreRefused) {
  const Miniature mini;
  const std::string latin1 = replaced(kTrain, "model.grow(loss)", "model.grow(  # se\xf1or\n            loss)");
  write_file(mini.tree() / "train.py", latin1);
  apply_to(mini);  // the comment is not within the replaced part
  revert_of(mini);
  EXPECT_EQ(mini.train(), latin1);
  mini.write_recipe(replaced(kRecipe, "\"anchor\": \"model.grow(\"", "\"anchor\": \"model.grow(loss\""));
  expect_contains(error_of([&] { apply_to(mini); }), "train.py: line 8: the comment in 'model.grow(loss' is not UTF-8");
  EXPECT_EQ(mini.train(), latin1);
  EXPECT_FALSE(mini.has_manifest());
}

/// Such a record may be from a program that wrote other bytes for those that are not UTF-8.
TEST(Patch, RecordsThatDoNotRestoreAFileChangeNothing) {
  const Miniature mini;
  apply_to(mini);
  const auto record = mini.tree() / ".splatboost/patch.json";
  write_file(record, replaced(read_file(record), "\"removed\": \"model.grow(\"", "\"removed\": \"model.grow( \""));
  const std::string told = ".splatboost/patch.json: does not match train.py: restore that file (git checkout train.py)";
  expect_contains(error_of([&] { revert_of(mini); }), told);
  expect_contains(error_of([&] { (void)verify(SourceTree(mini.tree())); }), told);
  expect_patched(mini);
  write_file(mini.tree() / "train.py", kTrain);
  revert_of(mini);
  mini.expect_pristine();
}

TEST(Patch, ReadOnlyFilesAreLeftAlone) {
  const Miniature mini;
  fs::permissions(mini.tree() / "scene/model.py", fs::perms(0444));
  expect_contains(error_of([&] { apply_to(mini); }), "scene/model.py: is read-only");
  mini.expect_pristine();
}

TEST(Patch, PermissionsStay) {
  const Miniature mini;
  fs::permissions(mini.tree() / "train.py", fs::perms(0750));
  apply_to(mini);
  EXPECT_EQ(fs::status(mini.tree() / "train.py").permissions(), fs::perms(0750));
}

TEST(Patch, OwnersStayWhenRootPatches) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root may give files away";
  constexpr uid_t kUser = 1234, kGroup = 1235;
  const Miniature mini;
  mini.bring_a_file();
  const auto tree = [&] { return fs::recursive_directory_iterator(mini.tree()); };
  ASSERT_EQ(::chown(mini.tree().c_str(), kUser, kGroup), 0);
  for (const auto& entry : tree()) ASSERT_EQ(::chown(entry.path().c_str(), kUser, kGroup), 0);
  const auto expect_owned = [&](std::size_t entries) {
    std::size_t count = 0;
    for (const auto& entry : tree()) {
      struct stat status {};
      ASSERT_EQ(::stat(entry.path().c_str(), &status), 0);
      EXPECT_EQ(status.st_uid, kUser) << entry.path();
      EXPECT_EQ(status.st_gid, kGroup) << entry.path();
      ++count;
    }
    EXPECT_EQ(count, entries);
  };
  apply_to(mini);
  expect_owned(8);  // train.py, scene/model.py, boost/boost.h, .splatboost/patch.json and its .gitignore
  revert_of(mini);
  expect_owned(3);
}

TEST(Patch, LinksWithinTheTreeStayLinks) {
  const Miniature mini;
  fs::rename(mini.tree() / "scene", mini.tree() / "real");
  fs::create_directory_symlink("real", mini.tree() / "scene");
  fs::rename(mini.tree() / "train.py", mini.tree() / "main.py");
  fs::create_symlink("main.py", mini.tree() / "train.py");
  apply_to(mini);
  EXPECT_TRUE(fs::is_symlink(mini.tree() / "train.py"));
  EXPECT_EQ(read_file(mini.tree() / "main.py"), kPatchedTrain);
  EXPECT_EQ(read_file(mini.tree() / "real/model.py"), kPatchedModel);
  revert_of(mini);
  EXPECT_EQ(read_file(mini.tree() / "main.py"), kTrain);
}

TEST(Patch, LinksOutOfTheTreeAreNotFollowed) {
  {
    const Miniature mini;
    write_file(mini.folder / "outside/model.py", kModel);
    fs::remove_all(mini.tree() / "scene");
    fs::create_directory_symlink(mini.folder / "outside", mini.tree() / "scene");
    expect_contains(error_of([&] { apply_to(mini); }), "scene/model.py: leads out of the tree");
    EXPECT_EQ(read_file(mini.folder / "outside/model.py"), kModel);
    EXPECT_EQ(mini.train(), kTrain);
  }
  {
    const Miniature mini;
    fs::create_directory(mini.folder / "outside");
    fs::create_directory_symlink(mini.folder / "outside", mini.tree() / ".splatboost");
    expect_contains(error_of([&] { apply_to(mini); }), ".splatboost/patch.json: leads out of the tree");
    EXPECT_EQ(mini.train(), kTrain);
    EXPECT_TRUE(fs::is_empty(mini.folder / "outside"));
  }
  {
    // A folder whose name starts with the tree's name is outside too.
    const Miniature mini;
    write_file(mini.folder / "tree2/train.py", kTrain);
    fs::remove(mini.tree() / "train.py");
    fs::create_symlink(mini.folder / "tree2/train.py", mini.tree() / "train.py");
    expect_contains(error_of([&] { apply_to(mini); }), "train.py: leads out of the tree");
  }
}

TEST(Patch, AFileInPlaceOfTheManifestsFolderIsTold) {
  const Miniature mini;
  write_file(mini.tree() / ".splatboost", "");
  expect_contains(error_of([&] { apply_to(mini); }), ".splatboost/.gitignore: its folder is a file: move it away");
  EXPECT_TRUE(fs::remove(mini.tree() / ".splatboost"));
  mini.expect_pristine();
}

TEST(Patch, MissingTreesAreTold) {
  const Miniature mini;
  expect_contains(error_of([&] { SourceTree{mini.folder / "none"}; }), "is not a folder");
  expect_contains(error_of([&] { SourceTree{mini.tree() / "train.py"}; }), "is not a folder");
  expect_contains(error_of([&] { (void)verify(SourceTree(mini.tree())); }), "not patched");
}

TEST(Patch, AFullDiskLeavesNothing) {
  const Miniature mini;
  const std::string large = kTrain + "# " + std::string(200'000, 'x') + "\n";
  write_file(mini.tree() / "train.py", large);
  rlimit old{};
  getrlimit(RLIMIT_FSIZE, &old);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{100'000, old.rlim_max};
  setrlimit(RLIMIT_FSIZE, &limit);
  const std::string line = error_of([&] { apply_to(mini); });
  setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, old_handler);
  expect_contains(line, "train.py: cannot be written: File too large");
  write_file(mini.tree() / "train.py", replaced(mini.train(), large, kTrain));
  mini.expect_pristine();
}

}  // namespace
}  // namespace splatboost::patch::test

// SPDX-License-Identifier: Apache-2.0
#include "tool/recipe.h"

#include <gtest/gtest.h>

#include "miniature.h"
#include "support/source_dir.h"

namespace splatboost::patch::test {
namespace {

TEST(Recipe, ReadsAllOfIt) {
  const Miniature mini;
  const Recipe recipe = mini.recipe();
  EXPECT_EQ(recipe.name, "mini");
  ASSERT_EQ(recipe.layouts.size(), 2u);
  EXPECT_FALSE(recipe.layouts[0].signs[1].present);
  ASSERT_EQ(recipe.edits.size(), 6u);
  EXPECT_EQ(recipe.edits[1].indent, 1);
  EXPECT_EQ(recipe.edits[4].count, 2);
  EXPECT_EQ(recipe.options.front().value, "on");
}

TEST(Recipe, MistakesAreNamedWithTheirPlace) {
  const Miniature mini;
  const auto error = [&](const std::string& what, const std::string& by) {
    mini.write_recipe(replaced(kRecipe, what, by));
    return error_of([&] { (void)mini.recipe(); });
  };
  expect_contains(error("\"format\": 1", "\"format\": 2"), "format must be 1");
  expect_contains(error("\"title\"", "\"tilte\""), "'title' is missing");
  expect_contains(error("\"title\"", "\"other\": 1, \"title\""), "unknown key 'other'");
  expect_contains(error("\"place\": \"after\"", "\"place\": \"beside\""), "edits[0]: place must be");
  expect_contains(error("\"indent\": 1", "\"indent\": -1"), "edits[1]: indent");
  expect_contains(error("\"count\": 2", "\"count\": 0"), "edits[4]: count");
  expect_contains(error("\"file\": \"train.py\"", "\"file\": \"../train.py\""), "within the tree");
  expect_contains(error("\"file\": \"train.py\"", "\"file\": \"/etc/passwd\""), "within the tree");
  expect_contains(error("[\"import hooks\"]", "[\"import\\nhooks\"]"), "edits[0]: snippet");
  expect_contains(error("[\"import hooks\"]", "[]"), "edits[0]: snippet");
  expect_contains(error("[\"import hooks\"]", "[\"import hooks\"], \"layouts\": [\"three\"]"), "no layout 'three'");
  const auto need = [&](const std::string& keys) {
    return error("\"edits\": [", "\"needs\": [{\"file\": \"train.py\", \"why\": \"x\", " + keys + "}], \"edits\": [");
  };
  expect_contains(need("\"def\": \"f\""), "needs[0]: 'parameters' is missing");
  expect_contains(need("\"call\": \"f\""), "needs[0]: call needs arguments, keywords or results");
  expect_contains(need("\"call\": \"f\", \"results\": 0"), "needs[0]: results must be a whole number from 1");
  expect_contains(need("\"call\": \"f\", \"results\": 1, \"parameters\": []"), "needs[0]: unknown key 'parameters'");
  expect_contains(need("\"call\": \"f\", \"results\": 1, \"layouts\": [\"three\"]"),
                  "needs[0]: layouts: there is no layout");
  expect_contains(error("{", "["), "is not JSON");
}

TEST(Recipe, MistakesShowWithoutACheckout) {
  const Miniature mini;
  const auto told = [&](const std::string& what, const std::string& by) {
    mini.write_recipe(replaced(kRecipe, what, by));
    const std::vector<std::string> found = mistakes(mini.recipe());
    return found.size() == 1 ? found.front() : std::to_string(found.size()) + " mistakes";
  };
  EXPECT_EQ(told("Miniature", "Small"), "0 mistakes");
  expect_contains(told("[\"import hooks\"]", "[\"import hooks\", \"f(1, [2)\"]"),
                  "edits[0]: the snippet leaves a bracket open");
  expect_contains(told("[\"boost.grow(\"]", "[\"boost.grow()\"]"), "edits[2]: the snippet leaves a bracket open");
  expect_contains(told("[\"boost.grow(\"]", "[\"model.grow(\"]"), "edits[2]: replaces nothing");
  // No edit of either layout adds --haste.
  mini.write_recipe(replaced(kRecipe, "\"--boost\"", "\"--haste\""));
  EXPECT_EQ(mistakes(mini.recipe()).size(), 2u);
  expect_contains(mistakes(mini.recipe()).front(), "options: no edit of layout 'one' adds --haste");
  expect_contains(told(", {\"file\": \"scene/model.py\", \"lacks\": \"radii\"}", ""),
                  "layouts: a checkout of 'two' has all signs of 'one' too");
}

TEST(Recipe, UnknownNamesListThoseThereAre) {
  const Miniature mini;
  expect_contains(error_of([&] { (void)load_recipe(mini.folder / "recipes", "maxi"); }), "available: mini");
  expect_contains(error_of([&] { (void)load_recipe(mini.folder / "none", "mini"); }), "not a folder of recipes");
}

TEST(Recipe, LayoutsAreToldApart) {
  const Miniature mini;
  const Recipe recipe = mini.recipe();
  std::string model = kModel, train = kTrain;
  const auto read = [&](const std::string& file) -> std::optional<std::string> {
    if (file == "train.py") return train;
    return file == "scene/model.py" ? std::optional(model) : std::nullopt;
  };
  EXPECT_EQ(detect_layout(recipe, read).name, "one");
  model = kModel + "  # no radii";
  EXPECT_EQ(detect_layout(recipe, read).name, "one") << "a comment is no sign";
  model = kModel + " + radii";
  EXPECT_EQ(detect_layout(recipe, read).name, "two");
  train = "nothing";
  const std::string line = error_of([&] { (void)detect_layout(recipe, read); });
  expect_contains(line, "unknown layout of mini");
  expect_contains(line, "train.py lacks 'model.grow('");
}

TEST(Recipe, FoldersAreFoundFromTheProgram) {
  const TemporaryFolder folder;
  write_file(folder / "prefix/bin/splatboost", "");
  write_file(folder / "source/build/release/bin/splatboost", "");
  expect_contains(error_of([&] { (void)find_recipes(folder / "prefix/bin/splatboost"); }), "--recipes");
  write_file(folder / "prefix/share/splatboost/patches/mini/recipe.json", kRecipe);
  write_file(folder / "source/patches/mini/recipe.json", kRecipe);
  EXPECT_EQ(find_recipes(folder / "prefix/bin/splatboost"), folder / "prefix/share/splatboost/patches");
  EXPECT_EQ(find_recipes(folder / "source/build/release/bin/splatboost"), folder / "source/patches");
}

TEST(Recipe, OurOwnAreWellFormed) {
  const std::filesystem::path folder = splatboost::test::source_dir() / "patches";
  for (const std::string& name : recipe_names(folder)) {
    const Recipe recipe = load_recipe(folder, name);
    EXPECT_EQ(mistakes(recipe), std::vector<std::string>()) << name;
    for (const Layout& layout : recipe.layouts) {
      int lines = 0;
      for (const Edit& edit : recipe.edits_of(layout.name)) {
        lines += edit.place == Place::replace ? 2 * edit.count : static_cast<int>(edit.snippet.size());
      }
      EXPECT_LT(lines, 50) << name << " " << layout.name;
    }
  }
}

}  // namespace
}  // namespace splatboost::patch::test

// SPDX-License-Identifier: Apache-2.0
/// @file A miniature host and a recipe for it, both written for the tests.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tool/patch_error.h"
#include "tool/recipe.h"

#include "support/temporary_folder.h"

namespace splatboost::patch::test {

using splatboost::test::expect_contains;
using splatboost::test::read_file;
using splatboost::test::TemporaryFolder;
using splatboost::test::write_file;

inline const std::string kTrain =
    "from model import Model\n"
    "import boost\n"
    "\n"
    "def training(options):\n"
    "    model = Model(options)\n"
    "    for iteration in range(options.iterations):\n"
    "        loss = model.loss()\n"
    "        model.grow(loss)\n"
    "        # Optimizer step\n"
    "        model.optimizer.step()\n"
    "        model.optimizer.zero_grad()\n";
// No line end at the end, as upstream files have it.
inline const std::string kModel =
    "import hooks\n"
    "class Model:\n"
    "    def __init__(self, options):\n"
    "        self.options = options\n"
    "\n"
    "    def grow(self, loss):\n"
    "        self.denominator += 1";

inline const std::string kRecipe = R"json({
  "format": 1, "title": "Miniature", "upstream": "https://example.org/mini",
  "layouts": [
    {"name": "one", "about": "as written", "first_commit": "1111111", "last_commit": "2222222",
     "detect": [{"file": "train.py", "contains": "model.grow("}, {"file": "scene/model.py", "lacks": "radii"}]},
    {"name": "two", "about": "with radii", "first_commit": "3333333", "last_commit": "4444444",
     "detect": [{"file": "train.py", "contains": "model.grow("}, {"file": "scene/model.py", "contains": "radii"}]}
  ],
  "options": [{"name": "--boost", "default": "on", "about": "off trains as before"}],
  "edits": [
    {"file": "train.py", "anchor": "from model import Model", "place": "after", "why": "imports the hooks",
     "snippet": ["import hooks"]},
    {"file": "train.py", "anchor": "for iteration in", "place": "after", "indent": 1, "why": "tells the time",
     "snippet": ["boost.begin(iteration)"]},
    {"file": "train.py", "anchor": "model.grow(", "place": "replace", "why": "grows by scores",
     "snippet": ["boost.grow("]},
    {"file": "train.py", "anchor": "# Optimizer step", "place": "before", "why": "prunes late",
     "snippet": ["if boost.due():", "    boost.prune()"]},
    {"file": "train.py", "anchor": "model.optimizer.", "place": "replace", "count": 2, "why": "steps by schedule",
     "snippet": ["boost.optimizer."]},
    {"file": "scene/model.py", "anchor": "self.denominator += 1", "place": "after", "why": "counts",
     "snippet": ["hooks.count(self)"]}
  ]
})json";

inline const std::string kPatchedTrain =
    "from model import Model\n"
    "import hooks\n"
    "import boost\n"
    "\n"
    "def training(options):\n"
    "    model = Model(options)\n"
    "    for iteration in range(options.iterations):\n"
    "        boost.begin(iteration)\n"
    "        loss = model.loss()\n"
    "        boost.grow(loss)\n"
    "        if boost.due():\n"
    "            boost.prune()\n"
    "        # Optimizer step\n"
    "        boost.optimizer.step()\n"
    "        boost.optimizer.zero_grad()\n";
inline const std::string kPatchedModel = kModel + "\n        hooks.count(self)";

/// The file that a recipe for a host in C++ adds.
inline const std::string kBrought = "// ours\n";
inline const std::string kRecipeThatBrings =
    kRecipe.substr(0, kRecipe.rfind('}')) +
    R"json(, "files": [{"file": "boost/boost.h", "source": "boost.h", "why": "our part"}]})json";

/// A source tree beside a folder of recipes.
struct Miniature {
  Miniature() {
    write_file(tree() / "train.py", kTrain);
    write_file(tree() / "scene/model.py", kModel);
    write_recipe(kRecipe);
  }

  std::filesystem::path tree() const { return folder / "tree"; }
  void write_recipe(const std::string& text) const { write_file(folder / "recipes/mini/recipe.json", text); }
  Recipe recipe() const { return load_recipe(folder / "recipes", "mini"); }
  std::string train() const { return read_file(tree() / "train.py"); }
  std::string model() const { return read_file(tree() / "scene/model.py"); }
  /// Makes the recipe add boost/boost.h.
  void bring_a_file() const {
    write_recipe(kRecipeThatBrings);
    write_file(folder / "recipes/mini/boost.h", kBrought);
  }
  std::filesystem::path brought() const { return tree() / "boost/boost.h"; }
  bool has_manifest() const { return std::filesystem::exists(tree() / ".splatboost"); }
  /// The tree has only the two original files, unchanged.
  void expect_pristine() const {
    EXPECT_EQ(train(), kTrain);
    EXPECT_EQ(model(), kModel);
    std::size_t files = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(tree())) files += entry.is_regular_file();
    EXPECT_EQ(files, 2u);
    EXPECT_FALSE(has_manifest());
  }

  TemporaryFolder folder;
};

inline std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return at == std::string::npos ? text : text.replace(at, what.size(), by);
}

/// Message of the PatchError that `action` throws, which must be one line.
template <class Action>
std::string error_of(Action&& action) {
  try {
    action();
  } catch (const PatchError& error) {
    std::string message = error.what();
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    return message;
  }
  ADD_FAILURE() << "nothing was thrown";
  return "";
}

}  // namespace splatboost::patch::test

// SPDX-License-Identifier: Apache-2.0
/// @file A recipe: which upstream, in which layouts, gets which edits. docs/patching.md tells the file format.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tool/edits/text_edit.h"

namespace splatboost::patch {

/// A sign by which a layout is known.
struct Sign {
  std::string file;
  std::string text;
  bool present = true;  ///< the file contains the text; false: it exists and lacks it

  bool operator==(const Sign&) const = default;
};

struct Layout {
  std::string name;
  std::string about;
  std::string first_commit;
  std::string last_commit;  ///< the one that was tried
  std::vector<Sign> signs;  ///< all hold in a tree of this layout
};

/// An option that the edits add to the host's command line.
struct HostOption {
  std::string name;
  std::string value;  ///< default
  std::string about;
};

/// What the snippets and their hooks rely on, besides the names that snippets use.
struct Need {
  enum class Kind { function, call, text };
  std::string file;
  Kind kind = Kind::function;
  std::string name;                     ///< of the function, what is called as it is written, or the text itself
  std::vector<std::string> parameters;  ///< a function's first ones in order, "*" for any name; more must be optional
  std::vector<std::string> keywords;    ///< a function: must know them; a call: takes these by name and nothing else
  int arguments = -1;                   ///< of each call; -1: any number
  int results = -1;                     ///< names that each call is assigned to; -1: any number
  std::string why;
  std::vector<std::string> layouts;  ///< names of the layouts it belongs to; empty: all
};

/// A file that the patch brings along.
struct OwnFile {
  std::string file;  ///< where it goes in the tree; nothing may be there
  std::string content;
  std::string why;
  std::vector<std::string> layouts;  ///< names of the layouts it belongs to; empty: all
};

struct Recipe {
  std::string name;
  std::string title;
  std::string upstream;  ///< address
  std::vector<Layout> layouts;
  std::vector<HostOption> options;
  std::vector<Edit> edits;  ///< in the order they are made
  std::vector<Need> needs;
  std::vector<OwnFile> files;
  std::string sha256;  ///< of the recipe file and of those that it brings along

  std::vector<Edit> edits_of(const std::string& layout) const;
  std::vector<Need> needs_of(const std::string& layout) const;
  std::vector<OwnFile> files_of(const std::string& layout) const;
};

/// Text of a file of a tree, by its path there; nullopt where there is none.
using FileReader = std::function<std::optional<std::string>(const std::string& file)>;

/// Reads and checks FOLDER/NAME/recipe.json. PatchError names the file and the key.
Recipe load_recipe(const std::filesystem::path& folder, const std::string& name);

/// Mistakes of a recipe that show without a checkout, each in one line: snippets that are no whole Python, options that
/// no edit adds, layouts that have all signs of another.
std::vector<std::string> mistakes(const Recipe& recipe);

/// Why a text misses a sign; empty if it does not. @param text nullopt: there is no such file
std::string misses(const Sign& sign, const std::optional<std::string>& text);

/// Names of the recipes in a folder, sorted.
std::vector<std::string> recipe_names(const std::filesystem::path& folder);

/// The one layout whose signs a tree shows; PatchError if there is none, naming the sign that the likeliest lacks.
const Layout& detect_layout(const Recipe& recipe, const FileReader& read);

/// The folder of recipes that belongs to a program: ../share/splatboost/patches beside an installed one, or `patches`
/// in a folder above (a build in the source tree). PatchError if there is none.
std::filesystem::path find_recipes(const std::filesystem::path& program);

}  // namespace splatboost::patch

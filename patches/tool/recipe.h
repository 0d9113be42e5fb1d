// SPDX-License-Identifier: Apache-2.0
/// @file A recipe: the upstream, its layouts, and the edits of each. docs/patching.md describes the file format.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tool/edits/text_edit.h"

namespace splatboost::patch {

/// A feature of the source tree that identifies a layout.
struct Sign {
  std::string file;
  std::string text;
  bool present = true;  ///< true: the file contains the text; false: it exists but does not

  bool operator==(const Sign&) const = default;
};

struct Layout {
  std::string name;
  std::string about;
  std::string first_commit;
  std::string last_commit;  ///< the one that was tested
  std::vector<Sign> signs;  ///< all of them hold in a tree of this layout
};

/// An option that the edits add to the host's command line.
struct HostOption {
  std::string name;
  std::string value;  ///< default
  std::string about;
};

/// An assumption about the host that the snippets and their hooks rely on, besides the names that they use.
struct Need {
  enum class Kind { function, call, text };
  std::string file;
  Kind kind = Kind::function;
  std::string name;                     ///< of the function; the called expression as written; or the text itself
  std::vector<std::string> parameters;  ///< the function's first ones, "*": any name; further ones must be optional
  std::vector<std::string> keywords;    ///< a function must have these; a call may pass only these, by name
  int arguments = -1;                   ///< of each call; -1: any number
  int results = -1;                     ///< number of names that each call is assigned to; -1: any number
  std::string why;
  std::vector<std::string> layouts;  ///< names of the layouts it belongs to; empty: all
};

/// A file that the patch adds.
struct OwnFile {
  std::string file;  ///< path in the tree, which must not exist yet
  std::string content;
  std::string why;
  std::vector<std::string> layouts;  ///< names of the layouts it belongs to; empty: all
};

struct Recipe {
  std::string name;
  std::string title;
  std::string upstream;  ///< URL
  std::vector<Layout> layouts;
  std::vector<HostOption> options;
  std::vector<Edit> edits;  ///< in the order in which they are made
  std::vector<Need> needs;
  std::vector<OwnFile> files;
  std::string sha256;  ///< of the recipe file and the files that it adds

  std::vector<Edit> edits_of(const std::string& layout) const;
  std::vector<Need> needs_of(const std::string& layout) const;
  std::vector<OwnFile> files_of(const std::string& layout) const;
};

/// Returns the text of a file, given its path relative to the tree; nullopt if there is no such file.
using FileReader = std::function<std::optional<std::string>(const std::string& file)>;

/// Reads and validates FOLDER/NAME/recipe.json. Throws PatchError, which names the file and the key.
Recipe load_recipe(const std::filesystem::path& folder, const std::string& name);

/// Mistakes of a recipe that can be found without a checkout, one line each: snippets that are not complete statements,
/// options that no edit adds, layouts that have all signs of another one.
std::vector<std::string> mistakes(const Recipe& recipe);

/// Why a sign does not hold for a file; empty if it holds. @param text the file's text; nullopt: there is no such file
std::string misses(const Sign& sign, const std::optional<std::string>& text);

/// Names of the recipes in a folder, sorted.
std::vector<std::string> recipe_names(const std::filesystem::path& folder);

/// The layout whose signs all hold in a tree. If there is none, throws PatchError, which names the sign that the most
/// likely layout lacks.
const Layout& detect_layout(const Recipe& recipe, const FileReader& read);

/// The folder of recipes of a program: ../share/splatboost/patches relative to an installed one, or `patches` in one of
/// the folders above it (a build in the source tree). Throws PatchError if there is none.
std::filesystem::path find_recipes(const std::filesystem::path& program);

}  // namespace splatboost::patch

// SPDX-License-Identifier: Apache-2.0
#include "tool/recipe.h"

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>

#include <nlohmann/json.hpp>

#include "tool/patch_error.h"
#include "tool/sha256.h"

namespace splatboost::patch {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kFormat = 1;
constexpr const char* kRecipeFile = "recipe.json";

/// An object of the recipe with its place in the file, for messages.
class Fields {
 public:
  Fields(const json& object, std::string place) : object_(object), place_(std::move(place)) {
    require(object.is_object(), place_ + " must be an object");
  }
  /// Refuses keys that were never read.
  void close() const {
    for (const auto& [key, value] : object_.items())
      require(read_.contains(key), place_ + ": unknown key '" + key + "'");
  }
  const json& at(const std::string& key) {
    read_.insert(key);
    require(object_.contains(key), place_ + ": '" + key + "' is missing");
    return object_[key];
  }
  bool has(const std::string& key) const { return object_.contains(key); }
  std::string text(const std::string& key) {
    const json& value = at(key);
    require(value.is_string() && !value.get_ref<const std::string&>().empty(),
            name(key) + " must be a non-empty string");
    return value.get<std::string>();
  }
  int whole(const std::string& key, int otherwise, int least) {
    if (!has(key)) return otherwise;
    const json& value = at(key);
    require(value.is_number_integer() && value.get<std::int64_t>() >= least && value.get<std::int64_t>() < 1000,
            name(key) + " must be a whole number from " + std::to_string(least));
    return value.get<int>();
  }
  std::vector<std::string> texts(const std::string& key) {
    const json& value = at(key);
    require(value.is_array(), name(key) + " must be a list of strings");
    for (const json& item : value) require(item.is_string(), name(key) + " must be a list of strings");
    return value.get<std::vector<std::string>>();
  }
  template <class Read>
  void each(const std::string& key, Read read) {
    const json& value = at(key);
    require(value.is_array(), name(key) + " must be a list");
    for (std::size_t i = 0; i < value.size(); ++i) read(Fields(value[i], name(key) + "[" + std::to_string(i) + "]"));
  }
  /// A path within the tree.
  std::string file(const std::string& key) {
    const std::string path = text(key);
    bool inside = !fs::path(path).is_absolute() && path.find('\\') == std::string::npos;
    for (const fs::path& part : fs::path(path)) inside = inside && part != ".." && part != "." && !part.empty();
    require(inside, name(key) + ": '" + path + "' must be a plain path within the tree");
    return path;
  }
  /// Names of layouts under "layouts".
  std::vector<std::string> layouts(const std::vector<Layout>& known) {
    const std::vector<std::string> names = texts("layouts");
    for (const std::string& one : names) {
      require(std::any_of(known.begin(), known.end(), [&](const Layout& layout) { return layout.name == one; }),
              name("layouts") + ": there is no layout '" + one + "'");
    }
    return names;
  }
  std::string name(const std::string& key) const { return place_ + ": " + key; }

 private:
  const json& object_;
  std::string place_;
  std::set<std::string> read_;
};

bool one_line(const std::string& text) { return text.find_first_of("\r\n") == std::string::npos; }

Layout read_layout(Fields fields) {
  Layout layout;
  layout.name = fields.text("name");
  layout.about = fields.text("about");
  layout.first_commit = fields.text("first_commit");
  layout.last_commit = fields.text("last_commit");
  fields.each("detect", [&](Fields sign) {
    Sign read;
    read.file = sign.file("file");
    read.present = !sign.has("lacks");
    read.text = sign.text(read.present ? "contains" : "lacks");
    require(one_line(read.text), sign.name("a sign") + " must be a single line");
    sign.close();
    layout.signs.push_back(read);
  });
  require(!layout.signs.empty(), fields.name("detect") + " must not be empty");
  fields.close();
  return layout;
}

Edit read_edit(Fields fields, const std::vector<Layout>& layouts) {
  Edit edit;
  edit.file = fields.file("file");
  edit.anchor = fields.text("anchor");
  const std::string place = fields.text("place");
  require(place == "before" || place == "after" || place == "replace",
          fields.name("place") + " must be before, after or replace");
  edit.place = place == "before" ? Place::before : place == "after" ? Place::after : Place::replace;
  edit.snippet = fields.texts("snippet");
  edit.indent = fields.whole("indent", 0, 0);
  edit.count = fields.whole("count", 1, 1);
  edit.why = fields.text("why");
  if (fields.has("layouts")) edit.layouts = fields.layouts(layouts);
  fields.close();

  require(one_line(edit.anchor), fields.name("anchor") + " must be a single line");
  require(!edit.snippet.empty() && !edit.snippet.front().empty(), fields.name("snippet") + " must not be empty");
  require(std::all_of(edit.snippet.begin(), edit.snippet.end(), one_line),
          fields.name("snippet") + ": each line must be a separate string");
  require(edit.place != Place::replace || (edit.snippet.size() == 1 && edit.indent == 0),
          fields.name("snippet") + " must be one part of a line without indent if the place is 'replace'");
  require(edit.place == Place::replace || edit.count == 1,
          fields.name("count") + " may exceed 1 only if the place is 'replace'");
  return edit;
}

Need read_need(Fields fields, const std::vector<Layout>& layouts) {
  Need need;
  need.file = fields.file("file");
  need.kind = fields.has("text") ? Need::Kind::text : fields.has("call") ? Need::Kind::call : Need::Kind::function;
  need.name = fields.text(need.kind == Need::Kind::text ? "text" : need.kind == Need::Kind::call ? "call" : "def");
  if (fields.has("keywords")) need.keywords = fields.texts("keywords");
  if (need.kind == Need::Kind::function) {
    need.parameters = fields.texts("parameters");
  } else if (need.kind == Need::Kind::call) {
    need.arguments = fields.whole("arguments", -1, 0);
    need.results = fields.whole("results", -1, 1);
    require(need.arguments >= 0 || need.results >= 0 || !need.keywords.empty(),
            fields.name("call") + " needs arguments, keywords or results");
  }
  need.why = fields.text("why");
  if (fields.has("layouts")) need.layouts = fields.layouts(layouts);
  fields.close();
  return need;
}

std::string content_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  require(in.good(), path.string() + ": cannot be read");
  return text.str();
}

/// @param folder of the recipe
OwnFile read_file(Fields fields, const fs::path& folder, const std::vector<Layout>& layouts) {
  OwnFile file;
  file.file = fields.file("file");
  file.content = content_of(folder / fields.file("source"));
  file.why = fields.text("why");
  if (fields.has("layouts")) file.layouts = fields.layouts(layouts);
  fields.close();
  require(!file.content.empty(), fields.name("source") + " must not be empty");
  return file;
}

/// Why a tree does not have this layout; empty if it has.
std::string misses(const Layout& layout, const FileReader& read) {
  for (const Sign& sign : layout.signs) {
    const std::string missed = misses(sign, read(sign.file));
    if (!missed.empty()) return missed;
  }
  return "";
}

std::string list_of(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list;
}

/// Number of opening brackets in code minus number of closing ones.
int open_brackets(const std::string& code, Language language) {
  const SourceCode source(code, language);
  int depth = 0;
  for (const char c : source.code()) {
    depth += c == '(' || c == '[' || c == '{';
    depth -= c == ')' || c == ']' || c == '}';
  }
  return depth;
}

template <class T>
std::vector<T> of_layout(const std::vector<T>& all, const std::string& layout) {
  std::vector<T> found;
  for (const T& one : all) {
    if (one.layouts.empty() || std::find(one.layouts.begin(), one.layouts.end(), layout) != one.layouts.end()) {
      found.push_back(one);
    }
  }
  return found;
}

}  // namespace

std::vector<Edit> Recipe::edits_of(const std::string& layout) const { return of_layout(edits, layout); }
std::vector<Need> Recipe::needs_of(const std::string& layout) const { return of_layout(needs, layout); }
std::vector<OwnFile> Recipe::files_of(const std::string& layout) const { return of_layout(files, layout); }

std::vector<std::string> mistakes(const Recipe& recipe) {
  std::vector<std::string> found;
  for (std::size_t i = 0; i < recipe.edits.size(); ++i) {
    const Edit& edit = recipe.edits[i];
    const std::string place = "edits[" + std::to_string(i) + "]: ";
    // A replacement must leave as many brackets open as the code that it replaces.
    const std::string removed = edit.place == Place::replace ? edit.anchor : "";
    std::string added;
    for (const std::string& line : edit.snippet) added += line + "\n";
    const Language language = language_of(edit.file);
    if (open_brackets(added, language) != open_brackets(removed, language)) {
      found.push_back(place + "the snippet leaves a bracket open or closes one too many");
    }
    if (edit.place == Place::replace && edit.snippet.front() == edit.anchor)
      found.push_back(place + "replaces nothing");
  }
  for (const Layout& layout : recipe.layouts) {
    const std::vector<Edit> edits = recipe.edits_of(layout.name);
    for (const HostOption& option : recipe.options) {
      const std::string name = option.name.substr(std::min(option.name.find_first_not_of('-'), option.name.size()));
      const bool added = std::any_of(edits.begin(), edits.end(), [&](const Edit& edit) {
        return std::any_of(edit.snippet.begin(), edit.snippet.end(),
                           [&](const std::string& line) { return line.find(name) != std::string::npos; });
      });
      const std::vector<OwnFile> files = recipe.files_of(layout.name);
      const bool brought = std::any_of(files.begin(), files.end(), [&](const OwnFile& file) {
        return file.content.find(name) != std::string::npos;
      });
      if (!added && !brought) found.push_back("options: no edit of layout '" + layout.name + "' adds " + option.name);
    }
    for (const Layout& other : recipe.layouts) {
      const bool within = std::all_of(layout.signs.begin(), layout.signs.end(), [&](const Sign& sign) {
        return std::find(other.signs.begin(), other.signs.end(), sign) != other.signs.end();
      });
      if (&other != &layout && within) {
        found.push_back("layouts: a checkout of '" + other.name + "' has all signs of '" + layout.name + "' too");
      }
    }
  }
  return found;
}

std::string misses(const Sign& sign, const std::optional<std::string>& text) {
  if (!text) return "there is no " + sign.file;
  const bool found = !anchor_places(*text, sign.text, 1, language_of(sign.file)).empty();
  return found == sign.present ? "" : sign.file + (sign.present ? " lacks '" : " has '") + sign.text + "'";
}

Recipe load_recipe(const fs::path& folder, const std::string& name) {
  const std::vector<std::string> names = recipe_names(folder);
  require(std::find(names.begin(), names.end(), name) != names.end(),
          "there is no recipe '" + name + "'; available: " + list_of(names));
  const fs::path path = folder / name / kRecipeFile;
  const std::string text = content_of(path);
  const json parsed = json::parse(text, nullptr, false);
  require(!parsed.is_discarded(), path.string() + ": is not JSON");
  Fields fields(parsed, path.string());
  require(fields.whole("format", 0, 0) == kFormat,
          path.string() + ": format must be " + std::to_string(kFormat) + ": recipe and program are incompatible");
  Recipe recipe;
  recipe.name = name;
  recipe.title = fields.text("title");
  recipe.upstream = fields.text("upstream");
  fields.each("layouts", [&](Fields layout) { recipe.layouts.push_back(read_layout(std::move(layout))); });
  require(!recipe.layouts.empty(), fields.name("layouts") + " must not be empty");
  fields.each("options", [&](Fields option) {
    recipe.options.push_back({option.text("name"), option.text("default"), option.text("about")});
    option.close();
  });
  fields.each("edits", [&](Fields edit) { recipe.edits.push_back(read_edit(std::move(edit), recipe.layouts)); });
  if (fields.has("needs")) {
    fields.each("needs", [&](Fields need) { recipe.needs.push_back(read_need(std::move(need), recipe.layouts)); });
  }
  std::string all = text;
  if (fields.has("files")) {
    fields.each("files", [&](Fields file) {
      recipe.files.push_back(read_file(std::move(file), path.parent_path(), recipe.layouts));
      all += recipe.files.back().content;
    });
  }
  recipe.sha256 = sha256(all);
  fields.close();
  for (const Layout& layout : recipe.layouts) {
    require(!recipe.edits_of(layout.name).empty(), path.string() + ": layout '" + layout.name + "' has no edits");
  }
  return recipe;
}

std::vector<std::string> recipe_names(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (fs::exists(entry.path() / kRecipeFile)) names.push_back(entry.path().filename().string());
  }
  require(!error, folder.string() + ": is not a folder of recipes");
  std::sort(names.begin(), names.end());
  return names;
}

const Layout& detect_layout(const Recipe& recipe, const FileReader& read) {
  std::vector<const Layout*> found;
  std::string nearest;
  for (const Layout& layout : recipe.layouts) {
    const std::string missed = misses(layout, read);
    if (missed.empty()) found.push_back(&layout);
    nearest += (nearest.empty() ? "" : "; ") + ("not " + layout.name + ", since " + missed);
  }
  require(!found.empty(), "unknown layout of " + recipe.name + " (" + nearest + "): give the folder of a checkout of " +
                              recipe.upstream + "; for a fork, splatboost patch doctor PATH shows the nearest recipe");
  require(found.size() == 1, "the tree looks like two layouts of " + recipe.name + ", " + found[0]->name + " and " +
                                 found.back()->name + ": patch a fresh checkout");
  return *found[0];
}

fs::path find_recipes(const fs::path& program) {
  constexpr int kLevels = 4;  // build/release/bin/splatboost
  fs::path folder = fs::weakly_canonical(program).parent_path();
  const auto is_folder_of_recipes = [](const fs::path& path) {
    std::error_code error;
    return fs::is_directory(path, error) && !recipe_names(path).empty();
  };
  const fs::path installed = folder.parent_path() / "share" / "splatboost" / "patches";
  if (is_folder_of_recipes(installed)) return installed;
  for (int level = 0; level < kLevels; ++level, folder = folder.parent_path()) {
    if (is_folder_of_recipes(folder / "patches")) return folder / "patches";
  }
  throw PatchError("no recipes found next to " + program.string() + " (searched " + installed.string() +
                   "): reinstall SplatBoost or give their folder with --recipes");
}

}  // namespace splatboost::patch

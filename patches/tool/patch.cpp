// SPDX-License-Identifier: Apache-2.0
#include "tool/patch.h"

#include <map>
#include <utility>

#include "tool/patch_error.h"
#include "tool/sha256.h"

namespace splatboost::patch {
namespace {

const char* const kInterrupted =
    "patching was interrupted here: mend the tree with splatboost patch revert PATH, then go on";

void add_diff(Outcome& outcome, const std::string& before, const std::string& after, const std::string& file) {
  const Diff diff = unified_diff(before, after, file);
  outcome.diff += diff.text;
  outcome.added += diff.added;
  outcome.removed += diff.removed;
  outcome.files.push_back(file);
}

std::string text_of(const SourceTree& tree, const std::string& file) {
  std::optional<std::string> text = tree.read(file);
  require(text.has_value(), file + ": is missing: restore it (git checkout " + file + ")");
  return std::move(*text);
}

std::string without_changes(std::string text, const PatchedFile& file) {
  for (auto change = file.changes.rbegin(); change != file.changes.rend(); ++change) {
    revert_change(text, *change, file.file);
  }
  return text;
}

/// Whether every file to be written still is as it was found.
bool untouched(const SourceTree& tree, const std::vector<FileChange>& writes,
               const std::map<std::string, std::string>& found) {
  for (const FileChange& write : writes) {
    if (tree.read(write.file) != found.at(write.file)) return false;
  }
  return true;
}

std::vector<std::string> names_of(const Manifest& manifest) {
  std::vector<std::string> names;
  for (const PatchedFile& file : manifest.files) names.push_back(file.file);
  return names;
}

}  // namespace

Outcome apply(const Recipe& recipe, const SourceTree& tree, Writing writing, const CommitObserver& observer) {
  if (const std::optional<Manifest> manifest = read_manifest(tree)) {
    require(manifest->state == State::applied, kInterrupted);
    require(manifest->recipe == recipe.name && manifest->recipe_sha256 == recipe.sha256,
            "the tree is patched with " +
                (manifest->recipe == recipe.name ? "another version of " + recipe.name : manifest->recipe) +
                ": revert that first (splatboost patch revert PATH)");
    Outcome outcome = verify(tree);
    outcome.nothing_to_do = true;
    outcome.diff.clear();
    return outcome;
  }

  const auto read = [&](const std::string& file) { return tree.read(file); };
  const Layout& layout = detect_layout(recipe, read);
  Manifest manifest{recipe.name, recipe.sha256, layout.name, State::applying, {}};
  std::vector<std::string> files;                                    // in the order of their first edit
  std::map<std::string, std::pair<std::string, std::string>> texts;  // before, after
  std::map<std::string, std::vector<Change>> changes;
  for (const Edit& edit : recipe.edits_of(layout.name)) {
    if (!texts.contains(edit.file)) {
      const std::string text = text_of(tree, edit.file);
      texts[edit.file] = {text, text};
      files.push_back(edit.file);
    }
    changes[edit.file].push_back(apply_edit(texts[edit.file].second, edit));
  }
  Outcome outcome;
  outcome.recipe = recipe.name;
  outcome.layout = layout.name;
  std::vector<FileChange> writes;
  std::map<std::string, std::string> found;
  for (const std::string& file : files) {
    const auto& [before, after] = texts[file];
    PatchedFile patched{file, sha256(before), sha256(after), sha256(before), changes[file]};
    // What cannot be taken back to the byte is not done.
    require(without_changes(after, patched) == before,
            file + ": the recipe's edits cannot be taken back from this file");
    manifest.files.push_back(std::move(patched));
    tree.require_writable(file);
    add_diff(outcome, before, after, file);
    writes.push_back({file, after});
    found[file] = before;
  }
  if (writing == Writing::dry_run) return outcome;

  write_manifest(tree, manifest);
  try {
    tree.commit(writes, observer);
  } catch (...) {
    if (untouched(tree, writes, found)) remove_manifest(tree);
    throw;
  }
  manifest.state = State::applied;
  write_manifest(tree, manifest);
  return outcome;
}

Outcome revert(const SourceTree& tree, Writing writing, const CommitObserver& observer) {
  std::optional<Manifest> manifest = read_manifest(tree);
  Outcome outcome;
  if (!manifest) {
    outcome.nothing_to_do = true;
    return outcome;
  }
  outcome.recipe = manifest->recipe;
  outcome.layout = manifest->layout;
  std::vector<FileChange> writes;
  std::map<std::string, std::string> found;
  for (PatchedFile& file : manifest->files) {
    const std::string text = text_of(tree, file.file);
    const std::string hash = sha256(text);
    if (hash == file.before || (manifest->state == State::reverting && hash == file.reverted)) continue;
    const std::string reverted = without_changes(text, file);
    tree.require_writable(file.file);
    if (hash != file.after) outcome.edited_by_user.push_back(file.file);
    file.reverted = sha256(reverted);
    add_diff(outcome, text, reverted, file.file);
    writes.push_back({file.file, reverted});
    found[file.file] = text;
  }
  if (writing == Writing::dry_run) return outcome;

  const State old_state = std::exchange(manifest->state, State::reverting);
  write_manifest(tree, *manifest);
  tree.remove_leftovers(names_of(*manifest));
  try {
    tree.commit(writes, observer);
  } catch (...) {
    if (untouched(tree, writes, found)) {
      manifest->state = old_state;
      write_manifest(tree, *manifest);
    }
    throw;
  }
  remove_manifest(tree);
  return outcome;
}

Outcome verify(const SourceTree& tree) {
  const std::optional<Manifest> manifest = read_manifest(tree);
  require(manifest.has_value(), "the tree is not patched: splatboost patch apply NAME PATH does that");
  require(manifest->state == State::applied, kInterrupted);
  Outcome outcome;
  outcome.recipe = manifest->recipe;
  outcome.layout = manifest->layout;
  for (const PatchedFile& file : manifest->files) {
    const std::string text = text_of(tree, file.file);
    const std::string hash = sha256(text);
    require(hash != file.before,
            file.file + ": is as it was before the patch: splatboost patch revert PATH, then apply anew");
    const std::string without = without_changes(text, file);
    if (hash != file.after) {
      outcome.edited_by_user.push_back(file.file);
    } else {
      require(sha256(without) == file.before, std::string(kManifestFile) + ": does not fit " + file.file);
    }
    add_diff(outcome, without, text, file.file);
  }
  return outcome;
}

}  // namespace splatboost::patch

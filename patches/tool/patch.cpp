// SPDX-License-Identifier: Apache-2.0
#include "tool/patch.h"

#include <algorithm>
#include <map>
#include <memory>
#include <utility>

#include "tool/fit.h"
#include "tool/patch_error.h"
#include "tool/sha256.h"

namespace splatboost::patch {
namespace {

const std::string kIgnoreAll = "*\n";  // content of kIgnoreFile

const char* const kInterrupted =
    "patching was interrupted here: repair the tree with splatboost patch revert PATH, then continue";

void add_diff(Outcome& outcome, const std::string& before, const std::string& after, const std::string& file) {
  const Diff diff = unified_diff(before, after, file);
  outcome.diff += diff.text;
  outcome.added += diff.added;
  outcome.removed += diff.removed;
  outcome.files.push_back(file);
}

std::string content_of(const SourceTree& tree, const std::string& file) {
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

/// As without_changes(). Throws PatchError if that does not give back the file as it was before the patch.
std::string original_of(const std::string& text, const std::string& hash, const PatchedFile& file) {
  std::string original = without_changes(text, file);
  const bool matches = hash != file.after || sha256(original) == file.before;
  require(matches, std::string(kManifestFile) + ": does not match " + file.file + ": restore that file (git checkout " +
                       file.file + "), then revert");
  return original;
}

/// Whether a file has none of its changes: the checkout's own file was restored. One that still names this library may
/// have an edited change.
bool restored(const std::string& text, const PatchedFile& file) {
  return text.find("splatboost") == std::string::npos &&
         std::all_of(file.changes.begin(), file.changes.end(),
                     [&](const Change& change) { return lacks(text, change); });
}

/// Whether a file belongs to the record rather than to the patch: it is not reported.
bool is_of_the_record(const PatchedFile& file) { return file.file == kIgnoreFile; }

std::vector<std::string> names_of(const Manifest& manifest) {
  std::vector<std::string> names;
  for (const PatchedFile& file : manifest.files) names.push_back(file.file);
  return names;
}

}  // namespace

std::vector<std::string> leftovers(const SourceTree& tree, const std::optional<Manifest>& manifest) {
  return tree.leftovers(manifest ? names_of(*manifest) : std::vector<std::string>(), kManifestFile);
}

Outcome apply(const Recipe& recipe, const SourceTree& tree, Writing writing) {
  const std::unique_ptr<TreeLock> lock = writing == Writing::write ? tree.lock() : nullptr;
  if (const std::optional<Manifest> manifest = read_manifest(tree)) {
    require(manifest->state == State::applied, kInterrupted);
    require(manifest->recipe == recipe.name && manifest->recipe_sha256 == recipe.sha256,
            "the tree is patched with " +
                (manifest->recipe == recipe.name ? "another version of " + recipe.name : manifest->recipe) +
                ": revert that first (splatboost patch revert PATH)");
    Outcome outcome = verify(tree);
    outcome.nothing_to_do = true;
    outcome.diff.clear();
    if (writing == Writing::write) tree.remove_leftovers(outcome.leftovers);
    return outcome;
  }

  const auto read = [&](const std::string& file) { return tree.read(file); };
  const Layout& layout = detect_layout(recipe, read);
  Manifest manifest{recipe.name, recipe.sha256, layout.name, State::applying, {}};
  std::vector<std::string> files;                                    // in the order of their first edit
  std::map<std::string, std::pair<std::string, std::string>> texts;  // before, after
  std::map<std::string, std::vector<Change>> changes;
  const std::vector<Edit> edits = recipe.edits_of(layout.name);
  for (const Edit& edit : edits) {
    if (!texts.contains(edit.file)) {
      const std::string text = content_of(tree, edit.file);
      texts[edit.file] = {text, text};
      files.push_back(edit.file);
    }
    auto& [before, after] = texts[edit.file];
    try {
      changes[edit.file].push_back(apply_edit(after, edit));
    } catch (const PatchError&) {
      std::string found = before;
      apply_edit(found, edit);  // throws with lines of the user's file, not of the half-edited one
      throw;
    }
  }
  for (const Need& need : recipe.needs_of(layout.name)) {
    const auto edited = texts.find(need.file);
    const std::string wrong = unmet(need, edited != texts.end() ? edited->second.first : content_of(tree, need.file));
    require(wrong.empty(), need.file + ": " + wrong + " (" + need.why + "); " + kForkAdvice);
  }
  std::map<std::string, std::size_t> made;  // number of changes of each file checked so far
  for (const Edit& edit : edits) {
    const auto& [before, after] = texts[edit.file];
    const std::string wrong = unknown_name(edit, changes[edit.file][made[edit.file]++], before, after);
    require(wrong.empty(), edit.file + ": " + wrong + "; " + kForkAdvice);
  }
  Outcome outcome;
  outcome.recipe = recipe.name;
  outcome.layout = layout.name;
  std::vector<FileChange> writes;
  for (const OwnFile& own : recipe.files_of(layout.name)) {  // first, so that no host file refers to a missing one
    tree.require_free(own.file);
    manifest.files.push_back({own.file, "", sha256(own.content), "", {}});
    add_diff(outcome, "", own.content, own.file);
    writes.push_back({own.file, own.content});
  }
  manifest.files.push_back({kIgnoreFile, "", sha256(kIgnoreAll), "", {}});
  writes.push_back({kIgnoreFile, kIgnoreAll});
  for (const std::string& file : files) {
    const auto& [before, after] = texts[file];
    PatchedFile patched{file, sha256(before), sha256(after), sha256(before), changes[file]};
    for (Change& change : patched.changes) {
      if (has_names_of(before, change.added)) change.known = count_names_of(before, change.added);
    }
    // Refuse an edit that could not be reverted exactly.
    require(without_changes(after, patched) == before, file + ": the recipe's edits cannot be reverted in this file");
    manifest.files.push_back(std::move(patched));
    tree.require_writable(file);
    add_diff(outcome, before, after, file);
    writes.push_back({file, after});
  }
  if (writing == Writing::dry_run) return outcome;

  const std::string under_way = text_of(manifest);
  manifest.state = State::applied;
  tree.commit({std::move(writes), kManifestFile, under_way, text_of(manifest)});
  return outcome;
}

Outcome revert(const SourceTree& tree, Writing writing) {
  const std::unique_ptr<TreeLock> lock = writing == Writing::write ? tree.lock() : nullptr;
  std::optional<Manifest> manifest = read_manifest(tree);
  Outcome outcome;
  outcome.leftovers = leftovers(tree, manifest);
  if (!manifest) {
    if (writing == Writing::write) tree.remove_leftovers(outcome.leftovers);
    outcome.nothing_to_do = true;
    return outcome;
  }
  outcome.recipe = manifest->recipe;
  outcome.layout = manifest->layout;
  std::vector<FileChange> writes;
  for (PatchedFile& file : manifest->files) {
    if (file.brought()) {
      const std::optional<std::string> text = tree.read(file.file);
      if (!text) continue;
      require(sha256(*text) == file.after,
              file.file + ": belongs to the patch and was changed: move it away, then revert");
      tree.require_writable(file.file);
      if (!is_of_the_record(file)) add_diff(outcome, *text, "", file.file);
      writes.push_back({file.file, std::nullopt});
      continue;
    }
    const std::string text = content_of(tree, file.file);
    const std::string hash = sha256(text);
    if (hash == file.before || (manifest->state == State::reverting && hash == file.reverted)) continue;
    if (restored(text, file)) {
      outcome.edited_by_user.push_back(file.file);
      continue;
    }
    const std::string reverted = original_of(text, hash, file);
    tree.require_writable(file.file);
    if (hash != file.after) outcome.edited_by_user.push_back(file.file);
    file.reverted = sha256(reverted);
    add_diff(outcome, text, reverted, file.file);
    writes.push_back({file.file, reverted});
  }
  if (writing == Writing::dry_run) return outcome;

  tree.remove_leftovers(outcome.leftovers);
  if (writes.empty()) {
    tree.remove_record(kManifestFile);  // needs no disk space
  } else {
    manifest->state = State::reverting;
    tree.commit({std::move(writes), kManifestFile, text_of(*manifest), std::nullopt});
  }
  return outcome;
}

Outcome verify(const SourceTree& tree) {
  const std::optional<Manifest> manifest = read_manifest(tree);
  require(manifest.has_value(), "the tree is not patched: patch it with splatboost patch apply NAME PATH");
  require(manifest->state == State::applied, kInterrupted);
  Outcome outcome;
  outcome.recipe = manifest->recipe;
  outcome.layout = manifest->layout;
  outcome.leftovers = leftovers(tree, manifest);
  for (const PatchedFile& file : manifest->files) {
    if (is_of_the_record(file)) continue;
    require(!file.brought() || tree.read(file.file).has_value(),
            file.file + ": belongs to the patch and is missing: run splatboost patch revert PATH, then apply again");
    const std::string text = content_of(tree, file.file);
    const std::string hash = sha256(text);
    require(hash != file.before,
            file.file + ": is the same as before the patch: run splatboost patch revert PATH, then apply again");
    require(file.brought() || !restored(text, file),
            file.file + ": contains nothing of the patch: run splatboost patch revert PATH, then apply again");
    const std::string without = file.brought() ? "" : original_of(text, hash, file);
    if (hash != file.after) outcome.edited_by_user.push_back(file.file);
    add_diff(outcome, without, text, file.file);
  }
  return outcome;
}

}  // namespace splatboost::patch

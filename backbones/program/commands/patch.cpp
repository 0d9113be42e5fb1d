// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "program/command_line/option_set.h"
#include "program/commands/commands.h"
#include "program/session/run_options.h"
#include "tool/doctor.h"
#include "tool/patch.h"
#include "tool/patch_error.h"
#include "trainer/support/input_error.h"
#include "trainer/support/text.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPlaces[] = {"above", "below", "in place of"};

std::string list_of(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list;
}

std::string size_of(const patch::Outcome& outcome) {
  return std::to_string(outcome.files.size()) + " files, +" + std::to_string(outcome.added) + " -" +
         std::to_string(outcome.removed) + " lines";
}

struct Patch {
  explicit Patch(CLI::App& command_app) : app(command_app) {
    app.require_subcommand(0, 1);
    add_checked_option(app, "--recipes", recipes, "folder of recipes [those of this program]")->type_name("DIR");
    list = subcommand("list", "List the recipes and their layouts");
    show = subcommand("show", "Show what a recipe changes, and why");
    apply = subcommand("apply", "Patch a checkout; patching it again changes nothing");
    verify = subcommand("verify", "Check that a patch is applied completely and exactly once");
    status = subcommand("status", "Show whether a checkout is patched, and which recipe fits it");
    doctor = subcommand("doctor", "Show which recipe is nearest to a checkout, and which parts of it match");
    revert = subcommand("revert", "Remove the patch and restore the files byte for byte; your own changes are kept");
    validate = subcommand("validate", "Check your own recipe for errors that can be found without a checkout");
    for (CLI::App* command : {show, apply, validate}) {
      add_checked_option(*command, "name", name, "name of the recipe, see splatboost patch list")
          ->type_name("NAME")
          ->required();
    }
    for (CLI::App* command : {apply, verify, status, doctor, revert}) {
      add_checked_option(*command, "path", path, "folder of the backbone's checkout")->type_name("PATH")->required();
    }
    for (CLI::App* command : {apply, revert}) {
      command->add_flag("--dry-run", dry_run, "only print the change as a unified diff");
    }
    show->footer("Example: splatboost patch show 3dgs");
    apply->footer("Example: splatboost patch apply mip-splatting ~/mip-splatting");
    verify->footer("Example: splatboost patch verify ~/mip-splatting");
    status->footer("Example: splatboost patch status ~/mip-splatting");
    validate->footer("Example: splatboost patch --recipes ~/recipes validate my-fork");
    doctor->footer("Example: splatboost patch doctor ~/my-fork-of-3dgs");
    revert->footer("Example: splatboost patch revert ~/mip-splatting");
  }

  int run() {
    try {
      if (list->parsed()) return run_list();
      if (show->parsed()) return run_show();
      if (apply->parsed()) return run_apply();
      if (verify->parsed()) return run_verify();
      if (status->parsed()) return run_status();
      if (doctor->parsed()) return run_doctor();
      if (validate->parsed()) return run_validate();
      if (revert->parsed()) return run_revert();
    } catch (const patch::WriteError&) {
      throw;  // a failure rather than a user error
    } catch (const patch::PatchError& error) {
      throw InputError(error.what());
    }
    throw UsageError("no command given; available: list, show, apply, verify, status, doctor, revert, validate");
  }

 private:
  CLI::App* subcommand(const std::string& command, const std::string& about) {
    CLI::App* sub = app.add_subcommand(command, about);
    sub->allow_extras();
    sub->group("Commands");
    return sub;
  }

  fs::path recipe_folder() const {
    return recipes.empty() ? patch::find_recipes(fs::read_symlink("/proc/self/exe")) : recipes;
  }

  patch::Recipe recipe() const { return patch::load_recipe(recipe_folder(), name); }

  /// A command to type, which finds the same recipes.
  std::string command(const std::string& arguments) const {
    const std::string option = recipes.empty() ? "" : "--recipes " + shell_word(recipes.string()) + " ";
    return "splatboost patch " + option + arguments;
  }
  std::string apply_command(const std::string& recipe) const {
    return command("apply " + recipe + " " + shell_word(path.string()));
  }
  std::string revert_command() const { return "splatboost patch revert " + shell_word(path.string()); }

  std::vector<std::string> recipe_names(const fs::path& folder) const {
    std::vector<std::string> names = patch::recipe_names(folder);
    if (names.empty()) throw InputError(folder.string() + ": contains no folder NAME with a recipe.json");
    return names;
  }

  /// A recipe one of whose layouts fits a tree. Throws ReadError.
  std::optional<patch::Recipe> fitting_recipe(const patch::SourceTree& tree) const {
    const fs::path folder = recipe_folder();
    for (const std::string& one : recipe_names(folder)) {
      patch::Recipe found = patch::load_recipe(folder, one);
      try {
        (void)patch::detect_layout(found, [&](const std::string& file) { return tree.read(file); });
        return found;
      } catch (const patch::ReadError&) {
        throw;
      } catch (const patch::PatchError&) {  // another recipe may fit
      }
    }
    return std::nullopt;
  }

  /// For a tree that is patched although it has no record: what to do. Empty for other trees.
  std::string lost_record(const patch::SourceTree& tree) const {
    const std::unique_ptr<patch::TreeLock> lock = tree.lock();  // not while another command patches it
    if (patch::read_manifest(tree)) return "";
    const fs::path folder = recipe_folder();
    std::set<std::string> files;
    for (const std::string& one : recipe_names(folder)) {
      files.merge(patch::edited_files(patch::load_recipe(folder, one),
                                      [&](const std::string& file) { return tree.read(file); }));
    }
    if (files.empty()) return "";
    std::string checkout = "git checkout HEAD --";
    for (const std::string& file : files) checkout += " " + shell_word(file);
    return path.string() + ": contains a patch, but not its record, " + patch::kManifestFile +
           ": restore the files as they were before the patch (" + checkout +
           ", which loses your changes in them; if the patch was committed, with a commit from before it)";
  }
  void require_record(const patch::SourceTree& tree) const {
    if (const std::string lost = lost_record(tree); !lost.empty()) throw InputError(lost);
  }

  int run_list() const {
    const fs::path folder = recipe_folder();
    for (const std::string& one : recipe_names(folder)) {
      const patch::Recipe found = patch::load_recipe(folder, one);
      std::printf("%-16s %s, %s\n", one.c_str(), found.title.c_str(), found.upstream.c_str());
      for (const patch::Layout& layout : found.layouts) {
        std::printf("  %-14s %s\n", layout.name.c_str(), layout.about.c_str());
      }
    }
    return 0;
  }

  int run_show() const {
    const patch::Recipe found = recipe();
    std::printf("%s: %s\n%s\n\nlayouts\n", found.name.c_str(), found.title.c_str(), found.upstream.c_str());
    for (const patch::Layout& layout : found.layouts) {
      std::printf("  %-10s %s (%.7s to %.7s)\n", layout.name.c_str(), layout.about.c_str(), layout.first_commit.c_str(),
                  layout.last_commit.c_str());
    }
    if (!found.options.empty()) std::printf("\noptions added to the host\n");
    for (const patch::HostOption& option : found.options) {
      std::printf("  %-24s %s [%s]\n", option.name.c_str(), option.about.c_str(), option.value.c_str());
    }
    std::printf("\nedits\n");
    for (const patch::Edit& edit : found.edits) {
      std::printf("  %s, %s '%s'%s%s\n    %s\n", edit.file.c_str(), kPlaces[static_cast<int>(edit.place)],
                  edit.anchor.c_str(), edit.count > 1 ? (" (" + std::to_string(edit.count) + " times)").c_str() : "",
                  edit.layouts.empty() ? "" : (" [" + list_of(edit.layouts) + "]").c_str(), edit.why.c_str());
      for (const std::string& line : edit.snippet) std::printf("      %s\n", line.c_str());
    }
    if (!found.files.empty()) std::printf("\nfiles\n");
    for (const patch::OwnFile& file : found.files) std::printf("  %s: %s\n", file.file.c_str(), file.why.c_str());
    if (!found.needs.empty()) std::printf("\nneeds\n");
    for (const patch::Need& need : found.needs) {
      const char* kind = need.kind == patch::Need::Kind::call ? "calls of " : "def ";
      std::printf("  %s, %s%s%s\n    %s\n", need.file.c_str(), need.kind == patch::Need::Kind::text ? "" : kind,
                  need.name.c_str(), need.layouts.empty() ? "" : (" [" + list_of(need.layouts) + "]").c_str(),
                  need.why.c_str());
    }
    return 0;
  }

  /// Throws PatchError that names the recipe to use if another one fits.
  void require_fit(const patch::Recipe& recipe, const patch::SourceTree& tree) const {
    if (patch::read_manifest(tree)) return;
    try {
      (void)patch::detect_layout(recipe, [&](const std::string& file) { return tree.read(file); });
    } catch (const patch::ReadError&) {
      throw;
    } catch (const patch::PatchError&) {
      const std::optional<patch::Recipe> other = fitting_recipe(tree);
      if (!other) throw;
      throw patch::PatchError(path.string() + ": " + recipe.name + " does not fit, but " + other->name +
                              " does: " + apply_command(other->name));
    }
  }

  int run_apply() const {
    const patch::Recipe found = recipe();
    const patch::SourceTree tree(path);
    require_record(tree);
    require_fit(found, tree);
    const patch::Outcome outcome = patch::apply(found, tree, dry_run ? patch::Writing::dry_run : patch::Writing::write);
    if (dry_run) {
      std::fputs(outcome.diff.c_str(), stdout);
    } else if (outcome.nothing_to_do) {
      std::printf("%s: patched already with %s (layout %s), %s\n", path.c_str(), found.name.c_str(),
                  outcome.layout.c_str(), size_of(outcome).c_str());
    } else {
      std::printf("%s: patched with %s (layout %s), %s\n", path.c_str(), found.name.c_str(), outcome.layout.c_str(),
                  size_of(outcome).c_str());
      // A recipe may have no --boost switch: it may only add what the host lacks, or switch elsewhere.
      const bool has_switch = std::any_of(found.options.begin(), found.options.end(),
                                          [](const patch::HostOption& option) { return option.name == "--boost"; });
      const std::string how = has_switch               ? "; --boost off trains as before the patch"
                              : !found.options.empty() ? "; " + command("show " + found.name) + " lists its options"
                                                       : "";
      const bool python = std::any_of(found.edits.begin(), found.edits.end(),
                                      [](const patch::Edit& edit) { return fs::path(edit.file).extension() == ".py"; });
      std::printf("Train as before%s. To undo: %s\n", how.c_str(), revert_command().c_str());
      if (python) std::printf("It needs the Python package splatboost where it trains (Python 3.8 or later).\n");
    }
    return 0;
  }

  int run_verify() const {
    const patch::SourceTree tree(path);
    require_record(tree);
    const patch::Outcome outcome = patch::verify(tree);
    std::printf("%s: the patch of %s (layout %s) is in place, %s\n", path.c_str(), outcome.recipe.c_str(),
                outcome.layout.c_str(), size_of(outcome).c_str());
    print_edited(outcome);
    if (!outcome.leftovers.empty()) {
      std::printf("an interrupted command left %s: %s removes it\n", list_of(outcome.leftovers).c_str(),
                  apply_command(outcome.recipe).c_str());
    }
    return 0;
  }

  int run_status() const {
    const patch::SourceTree tree(path);
    if (const std::optional<patch::Manifest> manifest = patch::read_manifest(tree)) {
      if (manifest->state == patch::State::applied) return run_verify();
      std::printf("%s: partly patched with %s, which was interrupted: %s repairs it\n", path.c_str(),
                  manifest->recipe.c_str(), revert_command().c_str());
      return 0;
    }
    const std::vector<std::string> left = patch::leftovers(tree, std::nullopt);
    if (!left.empty()) {
      std::printf("%s: not patched, but an interrupted command left %s: %s removes it\n", path.c_str(),
                  list_of(left).c_str(), revert_command().c_str());
      return 0;
    }
    if (const std::string lost = lost_record(tree); !lost.empty()) {
      std::printf("%s\n", lost.c_str());
      return 0;
    }
    const std::optional<patch::Recipe> found = fitting_recipe(tree);
    if (!found) {
      std::printf("%s: not patched, and no recipe fits it\n", path.c_str());
      return 0;
    }
    try {
      const patch::Outcome outcome = patch::apply(*found, tree, patch::Writing::dry_run);
      std::printf("%s: not patched; %s fits (layout %s), %s: %s\n", path.c_str(), found->name.c_str(),
                  outcome.layout.c_str(), size_of(outcome).c_str(), apply_command(found->name).c_str());
    } catch (const patch::PatchError& error) {
      std::printf("%s: not patched; %s would fit, but %s\n", path.c_str(), found->name.c_str(), error.what());
    }
    return 0;
  }

  int run_validate() const {
    const patch::Recipe found = recipe();
    const std::vector<std::string> wrong = patch::mistakes(found);
    if (!wrong.empty()) {
      std::string line = (recipe_folder() / name / "recipe.json").string() + ": " + wrong.front();
      if (wrong.size() > 1) line += "; and " + std::to_string(wrong.size() - 1) + " more mistakes";
      throw InputError(line);
    }
    std::printf("%s: well formed, %zu layouts, %zu edits, %zu needs; %s tries it on a checkout\n", name.c_str(),
                found.layouts.size(), found.edits.size(), found.needs.size(), command("doctor PATH").c_str());
    return 0;
  }

  int run_doctor() const {
    const patch::SourceTree tree(path);
    // A patched checkout tells nothing about the original host.
    if (patch::read_manifest(tree) || !lost_record(tree).empty()) return run_status();
    const fs::path folder = recipe_folder();
    std::vector<patch::Diagnosis> found;
    for (const std::string& one : recipe_names(folder)) {
      const patch::Recipe looked_at = patch::load_recipe(folder, one);
      for (patch::Diagnosis& diagnosis :
           patch::diagnose(looked_at, [&](const std::string& file) { return tree.read(file); })) {
        found.push_back(std::move(diagnosis));
      }
    }
    std::stable_sort(found.begin(), found.end(),
                     [](const patch::Diagnosis& a, const patch::Diagnosis& b) { return a.likeness() > b.likeness(); });
    if (found.empty() || found.front().held(patch::Sought::anchor) == 0) {
      std::printf("%s: no part of any recipe matches; give the folder of a backbone's checkout\n", path.c_str());
      return 0;
    }
    const patch::Diagnosis& nearest = found.front();
    std::printf("%s: nearest is %s, layout %s\n", path.c_str(), nearest.recipe.c_str(), nearest.layout.c_str());
    constexpr std::pair<patch::Sought, const char*> kSections[] = {{patch::Sought::sign, "signs of the layout"},
                                                                   {patch::Sought::anchor, "anchors of edits"},
                                                                   {patch::Sought::need, "what the edits rely on"}};
    for (const auto& [sought, title] : kSections) {
      std::printf("\n%s: %d of %d match\n", title, nearest.held(sought), nearest.all(sought));
      for (const patch::Finding& finding : nearest.findings) {
        if (finding.sought != sought) continue;
        const std::string place = finding.file + (finding.line > 0 ? ":" + std::to_string(finding.line) : "");
        std::printf("  %-2s %s  %s\n", finding.wrong.empty() ? "ok" : "no", place.c_str(), finding.what.c_str());
        if (!finding.wrong.empty()) std::printf("       %s\n", finding.wrong.c_str());
      }
    }
    std::printf("\nothers:");
    for (std::size_t i = 1; i < found.size(); ++i) {
      std::printf("%s %s %s (%.0f %%)", i > 1 ? "," : "", found[i].recipe.c_str(), found[i].layout.c_str(),
                  100 * found[i].likeness());
    }
    if (nearest.likeness() == 1) {
      std::printf("\nEverything matches: %s\n", apply_command(nearest.recipe).c_str());
    } else {
      std::printf(
          "\nTo patch it, copy the recipe %s and change what does not match: docs/patching.md, A recipe for a "
          "fork\n",
          (folder / nearest.recipe).c_str());
    }
    return 0;
  }

  int run_revert() const {
    const patch::SourceTree tree(path);
    require_record(tree);
    const patch::Outcome outcome = patch::revert(tree, dry_run ? patch::Writing::dry_run : patch::Writing::write);
    if (outcome.nothing_to_do) {
      if (!dry_run && outcome.leftovers.empty()) std::printf("%s: not patched\n", path.c_str());
      if (!dry_run && !outcome.leftovers.empty()) {
        std::printf("%s: not patched; removed %s, which an interrupted command left\n", path.c_str(),
                    list_of(outcome.leftovers).c_str());
      }
    } else if (dry_run) {
      std::fputs(outcome.diff.c_str(), stdout);
    } else {
      std::printf("%s: the patch of %s was removed\n", path.c_str(), outcome.recipe.c_str());
      print_edited(outcome);
    }
    return 0;
  }

  static void print_edited(const patch::Outcome& outcome) {
    if (!outcome.edited_by_user.empty()) {
      std::printf("your own changes are kept in %s\n", list_of(outcome.edited_by_user).c_str());
    }
  }

  CLI::App& app;
  CLI::App* list = nullptr;
  CLI::App* show = nullptr;
  CLI::App* apply = nullptr;
  CLI::App* verify = nullptr;
  CLI::App* status = nullptr;
  CLI::App* doctor = nullptr;
  CLI::App* validate = nullptr;
  CLI::App* revert = nullptr;
  fs::path recipes;
  std::string name;
  fs::path path;
  bool dry_run = false;
};

}  // namespace

Command add_patch(CLI::App& program) {
  CLI::App* app = program.add_subcommand(
      "patch", "Patch a checkout of a backbone's own repository to accelerate it, or revert the patch");
  app->footer("See splatboost patch COMMAND --help. Example: splatboost patch apply 3dgs ~/gaussian-splatting");
  const auto patch = std::make_shared<Patch>(*app);
  return {app, [patch](const std::string&) { return patch->run(); }};
}

}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
#include "tool/doctor.h"

#include <algorithm>
#include <map>

#include "tool/fit.h"
#include "tool/patch_error.h"

namespace splatboost::patch {
namespace {

std::string words_of(const Need& need) {
  if (need.kind == Need::Kind::text) return "'" + need.name + "'";
  return need.kind == Need::Kind::call ? "calls of " + need.name : "def " + need.name;
}

int line_of(const std::string& text, std::size_t place) {
  return 1 + static_cast<int>(std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(place), '\n'));
}

Diagnosis diagnose(const Recipe& recipe, const Layout& layout, const FileReader& read) {
  Diagnosis found{recipe.name, layout.name, {}};
  for (const Sign& sign : layout.signs) {
    found.findings.push_back({Sought::sign, sign.file, (sign.present ? "has '" : "lacks '") + sign.text + "'", 0,
                              misses(sign, read(sign.file))});
  }
  const std::vector<Edit> edits = recipe.edits_of(layout.name);
  std::map<std::string, std::string> patched;
  std::map<const Edit*, Change> changes;
  for (const Edit& edit : edits) {
    Finding finding{Sought::anchor, edit.file, "'" + edit.anchor + "'", 0, "there is no " + edit.file};
    if (const std::optional<std::string> text = read(edit.file)) {
      finding.wrong = anchor_problem(*text, edit);
      const std::vector<Match> places = edit_places(*text, edit);
      if (!places.empty()) finding.line = line_of(*text, places.front().begin);
      try {
        changes[&edit] = apply_edit(patched.try_emplace(edit.file, *text).first->second, edit);
      } catch (const PatchError& error) {
        if (finding.wrong.empty()) finding.wrong = error.what();
      }
    }
    found.findings.push_back(finding);
  }
  for (const Need& need : recipe.needs_of(layout.name)) {
    const std::optional<std::string> text = read(need.file);
    found.findings.push_back(
        {Sought::need, need.file, words_of(need), 0, text ? unmet(need, *text) : "there is no " + need.file});
  }
  // Names can be checked only for edits that could be made.
  for (const Edit& edit : edits) {
    const auto change = changes.find(&edit);
    if (change == changes.end()) continue;
    const std::string unknown = unknown_name(edit, change->second, *read(edit.file), patched.at(edit.file));
    const std::string what = "names of '" + edit.snippet.front() + "'";
    found.findings.push_back({Sought::need, edit.file, what, 0, unknown});
  }
  return found;
}

/// Whether a text contains all lines of a snippet. One that does not name this library's hooks is too common to tell.
bool contains(const std::string& text, const std::vector<std::string>& snippet) {
  const bool names_hooks = std::any_of(snippet.begin(), snippet.end(),
                                       [](const std::string& line) { return line.find("boost") != std::string::npos; });
  return names_hooks && std::all_of(snippet.begin(), snippet.end(), [&](const std::string& line) {
           const std::size_t first = line.find_first_not_of(' ');
           return first == std::string::npos || text.find(line.substr(first)) != std::string::npos;
         });
}

}  // namespace

int Diagnosis::all(Sought sought) const {
  return static_cast<int>(
      std::count_if(findings.begin(), findings.end(), [&](const Finding& one) { return one.sought == sought; }));
}

int Diagnosis::held(Sought sought) const {
  return static_cast<int>(std::count_if(findings.begin(), findings.end(),
                                        [&](const Finding& one) { return one.sought == sought && one.wrong.empty(); }));
}

double Diagnosis::likeness() const {
  const auto held_of_all =
      std::count_if(findings.begin(), findings.end(), [](const Finding& one) { return one.wrong.empty(); });
  return static_cast<double>(held_of_all) / static_cast<double>(findings.size());
}

std::set<std::string> edited_files(const Recipe& recipe, const FileReader& read) {
  std::set<std::string> files;
  for (const Edit& edit : recipe.edits) {
    const std::optional<std::string> text = read(edit.file);
    if (text && contains(*text, edit.snippet)) files.insert(edit.file);
  }
  return files;
}

std::vector<Diagnosis> diagnose(const Recipe& recipe, const FileReader& read) {
  std::vector<Diagnosis> found;
  for (const Layout& layout : recipe.layouts) found.push_back(diagnose(recipe, layout, read));
  return found;
}

}  // namespace splatboost::patch

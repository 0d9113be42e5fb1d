// SPDX-License-Identifier: Apache-2.0
#include "tool/fit.h"

#include <algorithm>

#include "tool/edits/source_code.h"

namespace splatboost::patch {
namespace {

std::string list_of(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list;
}

std::string place_of(const SourceCode& source, std::size_t statement) {
  return "line " + std::to_string(source.statements()[statement].line) + ": '" + source.show(statement) + "'";
}

/// How a signature fails to meet a need; empty if it meets it.
std::string misfit(const Function& function, const Need& need) {
  const std::vector<Parameter>& has = function.parameters;
  const std::string wanted = "expected (" + list_of(need.parameters) + ")";
  for (std::size_t i = 0; i < need.parameters.size(); ++i) {
    if (i >= has.size() || has[i].star) return wanted;
    if (need.parameters[i] != "*" && need.parameters[i] != has[i].name) return wanted;
  }
  for (const std::string& keyword : need.keywords) {
    if (std::none_of(has.begin(), has.end(), [&](const Parameter& one) { return one.name == keyword; })) {
      return "expected parameter " + keyword;
    }
  }
  for (std::size_t i = need.parameters.size(); i < has.size(); ++i) {
    const bool given = std::find(need.keywords.begin(), need.keywords.end(), has[i].name) != need.keywords.end();
    if (!has[i].optional && !has[i].star && !given) return wanted + " and no other parameter without a default";
  }
  return "";
}

/// All ways in which a call fails to meet a need; empty if it meets it.
std::string misfit(const Call& call, const Need& need) {
  std::vector<std::string> wrong;
  const int arguments = static_cast<int>(call.positional.size() + call.keywords.size());
  if (need.arguments >= 0 && (arguments != need.arguments || call.unpacked)) {
    wrong.push_back("expected " + std::to_string(need.arguments) + " arguments");
  }
  if (!need.keywords.empty()) {
    if (!call.positional.empty() || call.unpacked) wrong.emplace_back("expected arguments by name");
    for (const std::string& keyword : call.keywords) {
      if (std::find(need.keywords.begin(), need.keywords.end(), keyword) == need.keywords.end()) {
        wrong.push_back("expected no argument " + keyword);
      }
    }
  }
  if (need.results >= 0 && call.results != need.results) {
    wrong.push_back("expected " + (need.results == 1 ? "one result" : std::to_string(need.results) + " results"));
  }
  return list_of(wrong);
}

}  // namespace

std::string unmet(const Need& need, const std::string& text) {
  if (need.kind == Need::Kind::text) {
    const Language language = language_of(need.file);
    if (!anchor_places(text, need.name, 1, language).empty()) return "";
    return "'" + need.name + "' is missing" + nearest_place(text, need.name, language);
  }
  const SourceCode source(text);
  if (need.kind == Need::Kind::function) {
    const std::vector<Function> functions = source.functions(need.name);
    if (functions.empty())
      return "there is no def " + need.name + nearest_place(text, "def " + need.name, Language::python);
    for (const Function& function : functions) {
      const std::string wrong = misfit(function, need);
      if (!wrong.empty()) return place_of(source, function.statement) + ": " + wrong;
    }
    return "";
  }
  const std::vector<Call> calls = source.calls(need.name);
  if (calls.empty()) {
    return "there is no call of " + need.name + nearest_place(text, need.name, Language::python);
  }
  for (const Call& call : calls) {
    const std::string wrong = misfit(call, need);
    if (!wrong.empty()) return place_of(source, call.statement) + ": " + wrong;
  }
  return "";
}

std::string unknown_name(const Edit& edit, const Change& change, const std::string& original,
                         const std::string& patched) {
  if (language_of(edit.file) != Language::python) return "";  // a compiler reports unknown names
  std::string snippet;
  for (const std::string& line : edit.snippet) snippet += line + "\n";
  const SourceCode own(snippet);
  const std::vector<std::string> names = own.names_used(0, own.statements().size() - 1);
  const SourceCode source(patched);
  for (std::size_t at = patched.find(change.added); at != std::string::npos;
       at = patched.find(change.added, at + change.added.size())) {
    const std::size_t first = patched.find_first_not_of(" \t\r\n", at);
    const std::size_t statement = source.statement_at(first);
    for (const std::string& name : names) {
      if (source.knows(name, statement)) continue;
      const std::string what = "'" + name + "', which the patch uses, is not defined ";
      const std::optional<Function> function = source.function_around(statement);
      if (!function) return what + "at the top";
      const SourceCode before(original);
      return what + "in " + function->name + "(), " +
             place_of(before, before.functions(function->name).at(0).statement);
    }
  }
  return "";
}

}  // namespace splatboost::patch

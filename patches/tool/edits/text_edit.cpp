// SPDX-License-Identifier: Apache-2.0
#include "tool/edits/text_edit.h"

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include <nlohmann/json.hpp>

#include "tool/patch_error.h"

namespace splatboost::patch {
namespace {

constexpr std::string_view kSpaces = "    ";

std::vector<std::size_t> places_of(const std::string& text, const std::string& what) {
  std::vector<std::size_t> places;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + what.size())) {
    places.push_back(at);
  }
  return places;
}

/// Offsets of a change in a text. Inserted lines match only at the start of a line.
std::vector<std::size_t> places_of(const std::string& text, const Change& change) {
  std::vector<std::size_t> places = places_of(text, change.added);
  if (change.removed.empty()) {
    const bool own_end = change.added.front() == '\n' || change.added.front() == '\r';
    std::erase_if(places, [&](std::size_t at) { return !own_end && at > 0 && text[at - 1] != '\n'; });
  }
  return places;
}

std::string line_numbers(const std::string& text, const std::vector<std::size_t>& places) {
  std::string numbers;
  for (const std::size_t at : places) {
    const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n');
    numbers += (numbers.empty() ? "" : ", ") + std::to_string(line);
  }
  return numbers;
}

std::string line_numbers(const std::string& text, const std::vector<Match>& matches) {
  std::vector<std::size_t> places;
  places.reserve(matches.size());
  for (const Match& match : matches) places.push_back(match.begin);
  return line_numbers(text, places);
}

/// Whether the record of the patch, which is JSON, can hold a text.
bool can_be_recorded(const std::string& text) {
  try {
    (void)nlohmann::json(text).dump();
    return true;
  } catch (const nlohmann::json::exception&) {  // not UTF-8
    return false;
  }
}

std::string times(int count) { return count == 1 ? "once" : std::to_string(count) + " times"; }

std::string first_line(const std::string& text) {
  const std::size_t start = std::min(text.find_first_not_of("\r\n \t"), text.size());
  return text.substr(start, std::min(text.find_first_of("\r\n", start), text.size()) - start);
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    lines.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return lines;
}

std::string without_space(const std::string& line) {
  const std::size_t first = line.find_first_not_of(" \t\r");
  return first == std::string::npos ? "" : line.substr(first, line.find_last_not_of(" \t\r") + 1 - first);
}

/// How a text differs from the lines that a change added, if it does not contain them as they were added.
std::string alteration(const std::string& text, const std::string& added) {
  const std::vector<std::string> has = lines_of(text);
  std::string respaced;
  for (const std::string& line : lines_of(added)) {
    const std::string words = without_space(line);
    if (words.empty() || std::find(has.begin(), has.end(), line) != has.end()) continue;
    const bool same_words =
        std::any_of(has.begin(), has.end(), [&](const std::string& one) { return without_space(one) == words; });
    if (!same_words) return "the patch's '" + words + "' was removed or changed";
    if (respaced.empty()) respaced = words;
  }
  if (!respaced.empty()) return "the indentation or line end of the patch's '" + respaced + "' was changed";
  return "the patch's lines from '" + first_line(added) + "' on are not together any more";
}

/// The line end that a text uses at or after an offset.
std::string line_end(const std::string& text, std::size_t near) {
  const std::size_t here = text.find('\n', near);
  const std::size_t end = here != std::string::npos ? here : text.rfind('\n');
  return end != std::string::npos && end > 0 && text[end - 1] == '\r' ? "\r\n" : "\n";
}

}  // namespace

std::string nearest_place(const std::string& text, const std::string& code, Language language) {
  const SourceCode source(text, language);
  const std::optional<std::size_t> nearest = nearest_statement(source, code);
  if (!nearest) return "";
  return "; nearest is line " + std::to_string(source.statements()[*nearest].line) + ": '" + source.show(*nearest) +
         "'";
}

std::vector<Match> anchor_places(const std::string& text, const std::string& anchor, int count, Language language) {
  const SourceCode source(text, language);
  const bool own_comment = SourceCode(anchor, language).code().front() != anchor.front();
  const auto sought = [&](std::vector<Match> matches) {
    if (!own_comment) {
      std::erase_if(matches, [&](const Match& one) { return source.code()[one.begin] != text[one.begin]; });
    }
    return matches;
  };
  std::vector<Match> exact;
  for (const std::size_t at : places_of(text, anchor)) exact.push_back({at, at + anchor.size()});
  exact = sought(std::move(exact));
  if (static_cast<int>(exact.size()) == count) return exact;
  std::vector<Match> words = sought(find_words(source, anchor));
  return exact.empty() || static_cast<int>(words.size()) == count ? words : exact;
}

std::vector<Match> edit_places(const std::string& text, const Edit& edit) {
  return anchor_places(text, edit.anchor, edit.count, language_of(edit.file));
}

std::string anchor_problem(const std::string& text, const Edit& edit) {
  const std::vector<Match> places = edit_places(text, edit);
  const std::string anchor = "'" + edit.anchor + "'";
  if (places.empty()) return anchor + " is missing" + nearest_place(text, edit.anchor, language_of(edit.file));
  if (static_cast<int>(places.size()) == edit.count) return "";
  return anchor + " is on " + (places.size() == 1 ? "line " : "lines ") + line_numbers(text, places) + ", expected " +
         times(edit.count);
}

Change apply_edit(std::string& text, const Edit& edit) {
  const std::string problem = anchor_problem(text, edit);
  require(problem.empty(), edit.file + ": " + problem + "; " + kForkAdvice);
  const std::vector<Match> places = edit_places(text, edit);
  const SourceCode source(text, language_of(edit.file));
  const Statement statement = source.statements()[source.statement_at(places.front().begin)];
  const std::size_t end = text.find('\n', std::max(statement.end, places.front().end));

  Change change;
  change.count = edit.count;
  if (edit.place == Place::replace) {
    change.removed = text.substr(places.front().begin, places.front().end - places.front().begin);
    change.added = edit.snippet.front();
    for (const Match& place : places) {
      require(text.compare(place.begin, place.end - place.begin, change.removed) == 0,
              edit.file + ": '" + edit.anchor + "' is split into lines in different ways on lines " +
                  line_numbers(text, places) + ": write them in the same way, then patch");
    }
    require(can_be_recorded(change.removed),
            edit.file + ": line " + line_numbers(text, std::vector{places.front()}) + ": the comment in '" +
                edit.anchor +
                "' is not UTF-8, so that a revert could not restore it: save the file as UTF-8, then patch");
  } else {
    const std::size_t start = statement.begin;
    const std::string eol = line_end(text, places.front().begin);
    std::string indent = text.substr(start, text.find_first_not_of(" \t", start) - start);
    const std::string_view level = indent.find('\t') != std::string::npos ? "\t" : kSpaces;
    for (int i = 0; i < edit.indent; ++i) indent += level;
    for (const std::string& line : edit.snippet) change.added += (line.empty() ? "" : indent + line) + eol;
    if (edit.place == Place::after && end == std::string::npos) {  // the last line has no line end
      change.added = eol + change.added.substr(0, change.added.size() - eol.size());
    }
  }
  require(places_of(text, change).empty(),
          edit.file + ": already contains '" + first_line(change.added) +
              "': the tree is patched, but .splatboost/patch.json is missing; patch a fresh checkout");

  if (edit.place == Place::replace) {
    for (auto at = places.rbegin(); at != places.rend(); ++at)
      text.replace(at->begin, at->end - at->begin, change.added);
  } else if (edit.place == Place::before) {
    text.insert(statement.begin, change.added);
  } else {
    text.insert(end == std::string::npos ? text.size() : end + 1, change.added);
  }
  return change;
}

bool holds(const std::string& text, const Change& change) {
  return static_cast<int>(places_of(text, change).size()) == change.count;
}

bool lacks(const std::string& text, const Change& change) {
  if (!has_names_of(text, change.added)) return true;
  if (!places_of(text, change).empty()) return false;
  return change.removed.empty() ? count_names_of(text, change.added) <= change.known
                                : static_cast<int>(places_of(text, change.removed).size()) == change.count;
}

void revert_change(std::string& text, const Change& change, const std::string& file) {
  const std::vector<std::size_t> places = places_of(text, change);
  const std::string what = "'" + first_line(change.added) + "'";
  require(!places.empty(), file + ": " +
                               (change.removed.empty() ? alteration(text, change.added)
                                                       : "the patch's " + what + " was removed or changed") +
                               ": undo that, or restore the file as it was before the patch (git checkout " + file +
                               ", which loses your changes in it)");
  require(static_cast<int>(places.size()) == change.count, file + ": the patch's " + what + " is on lines " +
                                                               line_numbers(text, places) + ", expected " +
                                                               times(change.count) + ": restore that number");
  for (auto at = places.rbegin(); at != places.rend(); ++at) text.replace(*at, change.added.size(), change.removed);
}

}  // namespace splatboost::patch

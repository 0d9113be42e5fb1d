// SPDX-License-Identifier: Apache-2.0
/// @file One edit of one text: where, what, and how to take it back.
#pragma once

#include <string>
#include <vector>

#include "tool/edits/source_code.h"

namespace splatboost::patch {

enum class Place {
  before,  ///< lines above the statement of the anchor
  after,   ///< lines below it
  replace  ///< the anchor itself, within its statement
};

/// An edit as a recipe tells it. The anchor is a piece of one statement of the host's file; how its lines are broken
/// does not count.
struct Edit {
  std::string file;  ///< relative to the tree, '/' between folders
  std::string anchor;
  Place place = Place::after;
  std::vector<std::string> snippet;  ///< lines without indentation of the anchor and without line ends; replace: one
  int indent = 0;                    ///< levels deeper than the line of the anchor
  int count = 1;                     ///< how often the anchor stands in the file; more than once for replace only
  std::string why;
  std::vector<std::string> layouts;  ///< names of the layouts it belongs to; empty: all
};

/// An edit as it was made. Replacing `added` by `removed` wherever it stands takes it back.
struct Change {
  std::string removed;
  std::string added;
  int count = 1;

  bool operator==(const Change&) const = default;
};

/// What a message about code that a recipe does not know ends with.
inline constexpr const char* kForkAdvice =
    "a fork needs a recipe of its own: splatboost patch doctor PATH shows what "
    "else differs, docs/patching.md how to write one";

/// The statement of a file that is most like a piece of code, as "; nearest is line 7: '…'"; else empty.
std::string nearest_place(const std::string& text, const std::string& code, Language language);

/// Where an anchor stands in a text: as it is written, else with other line breaks. @return places as often as wanted
/// or, where it stands more or less often, those there are
std::vector<Match> anchor_places(const std::string& text, const std::string& anchor, int count, Language language);

/// Why an edit cannot be made: its anchor is missing, with the nearest place, or stands there too often; empty if it
/// can.
std::string anchor_problem(const std::string& text, const Edit& edit);

/// Makes an edit. Line ends, indentation and a missing last line end are as the file has them.
/// @param text is changed; unless the anchor stands there as often as told, PatchError names file and anchor
Change apply_edit(std::string& text, const Edit& edit);

/// Takes a change back. @param text is changed; PatchError names the file where the change is no longer as it was made
void revert_change(std::string& text, const Change& change, const std::string& file);

/// Whether a change is in the text as it was made.
bool holds(const std::string& text, const Change& change);

}  // namespace splatboost::patch

// SPDX-License-Identifier: Apache-2.0
/// @file A single edit of a text: finding its place, making it and reverting it.
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

/// An edit as a recipe specifies it. The anchor is a part of one statement of the host's file; line breaks and comments
/// in it do not matter.
struct Edit {
  std::string file;  ///< relative to the tree, '/' between folders
  std::string anchor;
  Place place = Place::after;
  std::vector<std::string> snippet;  ///< lines without the anchor's indentation and line ends; replace: one line
  int indent = 0;                    ///< levels deeper than the line of the anchor
  int count = 1;                     ///< how often the anchor occurs in the file; above 1 for replace only
  std::string why;
  std::vector<std::string> layouts;  ///< names of the layouts it belongs to; empty: all
};

/// An edit as it was made. Replacing every occurrence of `added` by `removed` reverts it.
struct Change {
  std::string removed;
  std::string added;
  int count = 1;
  int known = 0;  ///< how often the file before the patch has the names in `added`; 0: it lacks one of them

  bool operator==(const Change&) const = default;
};

/// End of every message about code that a recipe does not match.
inline constexpr const char* kForkAdvice =
    "a fork needs its own recipe: splatboost patch doctor PATH shows what "
    "else differs, docs/patching.md describes how to write one";

/// The statement of a file most similar to a piece of code, as "; nearest is line 7: '…'"; empty if there is none.
std::string nearest_place(const std::string& text, const std::string& code, Language language);

/// Occurrences of an anchor in a text, without those that begin in a comment or inside a string, unless the anchor
/// itself begins with a comment. Those that match exactly are preferred; if their number is not `count`, other line
/// breaks and comments are allowed too. @return `count` places if there are that many; otherwise those found
std::vector<Match> anchor_places(const std::string& text, const std::string& anchor, int count, Language language);

/// anchor_places() of an edit's anchor.
std::vector<Match> edit_places(const std::string& text, const Edit& edit);

/// Why an edit cannot be made: its anchor is missing (with the most similar place) or does not occur `count` times;
/// empty if it can be made.
std::string anchor_problem(const std::string& text, const Edit& edit);

/// Makes an edit, with the file's own line ends and indentation; a missing final line end stays missing. @param text is
/// changed. Throws PatchError, which names file and anchor, unless the anchor occurs `count` times.
Change apply_edit(std::string& text, const Edit& edit);

/// Reverts a change in `text`. Throws PatchError, which names the file, if the change is no longer as it was made.
void revert_change(std::string& text, const Change& change, const std::string& file);

/// Whether a change is in the text as it was made.
bool holds(const std::string& text, const Change& change);

/// Whether a text certainly lacks a change, even in an edited form: some name that it adds is missing, all that it
/// replaced is back, or those that the file had before are not more than then.
bool lacks(const std::string& text, const Change& change);

}  // namespace splatboost::patch

// SPDX-License-Identifier: Apache-2.0
/// @file Whether a host is as a recipe's snippets take it to be: signatures, calls, unpacked results, names.
#pragma once

#include <string>
#include <vector>

#include "tool/edits/text_edit.h"
#include "tool/recipe.h"

namespace splatboost::patch {

/// What of a file is not as a need says, with the place, such as "def f(a, b) on line 7 …"; empty where all is.
std::string unmet(const Need& need, const std::string& text);

/// A name that the snippet of an edit of a Python file uses and the host does not know where the snippet stands, with
/// the place; empty where all are known, and for other languages. @param original the file's text without edits, for
/// the line. @param patched with all of them
std::string unknown_name(const Edit& edit, const Change& change, const std::string& original,
                         const std::string& patched);

}  // namespace splatboost::patch

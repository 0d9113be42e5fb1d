// SPDX-License-Identifier: Apache-2.0
/// @file Checks that a host is what a recipe's snippets assume: signatures, calls, unpacked results, names.
#pragma once

#include <string>
#include <vector>

#include "tool/edits/text_edit.h"
#include "tool/recipe.h"

namespace splatboost::patch {

/// How a file fails to meet a need, with the place, such as "line 7: 'def f(a, b)': …"; empty if it meets it.
std::string unmet(const Need& need, const std::string& text);

/// A name that the snippet of an edit uses but that is not defined where the snippet is inserted, with the place; empty
/// if there is none, and always for languages other than Python. @param original the file's text without edits, used to
/// report the line @param patched the text with all edits
std::string unknown_name(const Edit& edit, const Change& change, const std::string& original,
                         const std::string& patched);

}  // namespace splatboost::patch

// SPDX-License-Identifier: Apache-2.0
/// @file Files appear whole or not at all.
#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <string>

namespace splatboost {

/// Lets `write` fill a file beside `path` and renames it onto `path` once all bytes are on disk. On failure (disk
/// full, no permission) the old file stays, the new one is removed, and std::runtime_error names path and cause.
void write_file_atomically(const std::filesystem::path& path, const std::function<void(std::ostream&)>& write);

/// Same for text at hand.
void write_text_atomically(const std::filesystem::path& path, const std::string& text);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file The files that a command wrote into a folder and may delete, as opposed to those that users added there.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string_view>

namespace splatboost {

/// A file, or a folder with all that a command writes into it.
struct OwnEntry {
  std::string_view name;   ///< in the folder that the command writes into
  std::string_view files;  ///< of a folder: extended regular expression of the paths in it; empty: a file
};

/// The first file in an own folder that its expression does not describe, or an entry that is a folder instead of a
/// file or the reverse. None if all may be deleted. Files whose name begins with a dot, as working files and those of
/// file managers, and links to folders do not count. Throws InputError if a folder cannot be read.
std::optional<std::filesystem::path> find_foreign_file(const std::filesystem::path& folder,
                                                       std::span<const OwnEntry> own);

/// Removes the own entries of the folder; call find_foreign_file() first. Throws InputError if one cannot be removed.
void remove_own_files(const std::filesystem::path& folder, std::span<const OwnEntry> own);

}  // namespace splatboost

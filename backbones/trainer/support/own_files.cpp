// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/own_files.h"

#include <regex>
#include <string>
#include <system_error>

#include "trainer/support/input_error.h"

namespace splatboost {

namespace fs = std::filesystem;

std::optional<fs::path> find_foreign_file(const fs::path& folder, std::span<const OwnEntry> own) {
  for (const OwnEntry& entry : own) {
    const fs::path path = folder / entry.name;
    std::error_code error;
    if (!fs::exists(path, error)) continue;
    const bool is_folder = fs::is_directory(path, error);
    if (is_folder == entry.files.empty()) return path;
    if (!is_folder) continue;
    const std::regex files(entry.files.begin(), entry.files.end());
    for (fs::recursive_directory_iterator at(path, error), end; !error && at != end; at.increment(error)) {
      std::error_code ignored;
      if (at->is_directory(ignored) || at->path().filename().native().starts_with('.')) continue;
      if (!std::regex_match(at->path().lexically_relative(path).native(), files)) return at->path();
    }
    require(!error, path.string() + ": cannot be read: " + error.message());
  }
  return std::nullopt;
}

void remove_own_files(const fs::path& folder, std::span<const OwnEntry> own) {
  for (const OwnEntry& entry : own) {
    std::error_code error;
    fs::remove_all(folder / entry.name, error);
    require(!error, (folder / entry.name).string() + ": cannot be replaced: " + error.message());
  }
}

}  // namespace splatboost

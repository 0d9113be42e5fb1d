// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/own_files.h"

#include <regex.h>

#include <stdexcept>
#include <string>
#include <system_error>

#include "trainer/support/input_error.h"

namespace splatboost {

namespace fs = std::filesystem;

namespace {

/// An extended regular expression of POSIX. (std::regex warns within GCC 12's own header with sanitizers.)
class Expression {
 public:
  explicit Expression(std::string_view text) {
    const std::string whole = "^(" + std::string(text) + ")$";
    if (::regcomp(&compiled_, whole.c_str(), REG_EXTENDED | REG_NOSUB) != 0) {
      throw std::logic_error("not a regular expression: " + whole);
    }
  }
  ~Expression() { ::regfree(&compiled_); }
  Expression(const Expression&) = delete;
  Expression& operator=(const Expression&) = delete;

  bool matches(const std::string& text) const { return ::regexec(&compiled_, text.c_str(), 0, nullptr, 0) == 0; }

 private:
  regex_t compiled_{};
};

}  // namespace

std::optional<fs::path> find_foreign_file(const fs::path& folder, std::span<const OwnEntry> own) {
  for (const OwnEntry& entry : own) {
    const fs::path path = folder / entry.name;
    std::error_code error;
    if (!fs::exists(path, error)) continue;
    const bool is_folder = fs::is_directory(path, error);
    if (is_folder == entry.files.empty()) return path;
    if (!is_folder) continue;
    const Expression files(entry.files);
    for (fs::recursive_directory_iterator at(path, error), end; !error && at != end; at.increment(error)) {
      std::error_code ignored;
      if (at->is_directory(ignored) || at->path().filename().native().starts_with('.')) continue;
      if (!files.matches(at->path().lexically_relative(path).native())) return at->path();
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

// SPDX-License-Identifier: Apache-2.0
/// @file A private folder in the system's folder for temporary files.
#pragma once

#include <stdlib.h>  // mkdtemp (POSIX)

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>

namespace splatboost {

/// Empty when created; removed with all its content by the destructor.
class TemporaryFolder {
 public:
  /// Throws std::system_error if it cannot be created.
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "splatboost-XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) throw std::system_error(errno, std::generic_category(), pattern);
    path_ = pattern;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace splatboost

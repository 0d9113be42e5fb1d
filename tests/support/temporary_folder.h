// SPDX-License-Identifier: Apache-2.0
/// @file Helpers shared by the tests of the data layer.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "support/source_dir.h"
#include "trainer/support/input_error.h"
#include "trainer/support/temporary_folder.h"

namespace splatboost::test {

using splatboost::TemporaryFolder;

inline std::string read_file(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

inline void write_file(const std::filesystem::path& path, const std::string& content) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << content;
}

inline std::size_t files_in(const std::filesystem::path& folder) {
  std::size_t count = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder)) ++count;
  return count;
}

/// Message of the InputError that `action` throws. Fails unless it throws one whose message is a single line.
template <class Action>
std::string input_error_of(Action&& action) {
  try {
    action();
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    return message;
  } catch (const std::exception& error) {
    ADD_FAILURE() << "not an InputError: " << error.what();
    return "";
  }
  ADD_FAILURE() << "nothing was thrown";
  return "";
}

inline void expect_contains(const std::string& message, const std::string& part) {
  EXPECT_NE(message.find(part), std::string::npos) << "'" << part << "' is missing in: " << message;
}

/// Path of a dataset in $SPLATBOOST_DATA or the default folder; empty if it is not there.
inline std::filesystem::path shared_data(const std::string& name) {
  const char* given = std::getenv("SPLATBOOST_DATA");
  const std::filesystem::path root = given != nullptr ? std::filesystem::path(given) : source_dir() / "../shared/data";
  const std::filesystem::path folder = root / name;
  return std::filesystem::is_directory(folder) ? folder : std::filesystem::path();
}

}  // namespace splatboost::test

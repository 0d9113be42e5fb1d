// SPDX-License-Identifier: Apache-2.0
/// @file Checkpoint files: named arrays of numbers, written whole or not at all.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace splatboost {

/// Collects named arrays, then writes them to one file. put() replaces an entry of the same name.
class ArchiveWriter {
 public:
  void put(std::string_view name, std::span<const float> values);
  void put(std::string_view name, std::span<const std::uint32_t> values);
  void put(std::string_view name, std::int64_t value);
  void put(std::string_view name, std::string_view text);
  /// Atomic; see atomic_file.h.
  void write(const std::filesystem::path& path) const;

 private:
  std::map<std::string, std::vector<std::byte>, std::less<>> entries_;
};

/// Reads such a file into memory; throws InputError if it cannot be read or its checksum does not match. The getters
/// throw InputError naming the file and the entry if the entry is missing, of another type or incomplete.
class ArchiveReader {
 public:
  explicit ArchiveReader(std::filesystem::path path);
  std::vector<float> floats(std::string_view name) const;
  std::vector<std::uint32_t> indices(std::string_view name) const;
  std::int64_t integer(std::string_view name) const;
  std::string text(std::string_view name) const;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::span<const std::byte> entry(std::string_view name) const;
  std::filesystem::path path_;
  std::map<std::string, std::vector<std::byte>, std::less<>> entries_;
};

}  // namespace splatboost

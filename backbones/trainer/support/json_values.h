// SPDX-License-Identifier: Apache-2.0
/// @file Reads single values from JSON, with errors that name the key.
#pragma once

#include <cmath>
#include <concepts>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "trainer/support/input_error.h"

namespace splatboost {

[[noreturn]] inline void wrong_type(const std::string& place, const char* wanted) {
  throw InputError(place + " must be " + wanted);
}

inline void read_value(const nlohmann::json& json, const std::string& place, bool& value) {
  if (!json.is_boolean()) wrong_type(place, "true or false");
  value = json.get<bool>();
}

template <std::integral T>
requires(!std::same_as<T, bool>) void read_value(const nlohmann::json& json, const std::string& place, T& value) {
  if (!json.is_number_integer()) wrong_type(place, "a whole number");
  // The range is checked before narrowing, in the type of the JSON number.
  const bool fits = json.is_number_unsigned() ? std::in_range<T>(json.get<std::uint64_t>())
                                              : std::in_range<T>(json.get<std::int64_t>());
  if (!fits) wrong_type(place, "a number in range");
  value = json.get<T>();
}

template <std::floating_point T>
void read_value(const nlohmann::json& json, const std::string& place, T& value) {
  if (!json.is_number()) wrong_type(place, "a number");
  // The range is checked before narrowing: casting a double beyond the range of float is undefined.
  const auto given = json.get<double>();
  if (!(std::abs(given) <= static_cast<double>(std::numeric_limits<T>::max()))) wrong_type(place, "a number in range");
  value = static_cast<T>(given);
}

inline void read_value(const nlohmann::json& json, const std::string& place, std::string& value) {
  if (!json.is_string()) wrong_type(place, "a string");
  value = json.get<std::string>();
}

inline void read_value(const nlohmann::json& json, const std::string& place, std::filesystem::path& value) {
  if (!json.is_string()) wrong_type(place, "a path");
  value = json.get<std::string>();
}

template <class T>
void read_value(const nlohmann::json& json, const std::string& place, std::vector<T>& values) {
  if (!json.is_array()) wrong_type(place, "a list");
  values.assign(json.size(), T{});
  for (std::size_t i = 0; i < json.size(); ++i) read_value(json[i], place, values[i]);
}

template <class T>
void read_value(const nlohmann::json& json, const std::string& place, std::optional<T>& value) {
  if (json.is_null()) {
    value.reset();
  } else {
    read_value(json, place, value.emplace());
  }
}

/// Parses a document; // comments are allowed. Throws InputError, beginning with `place`, if the text is not JSON, is
/// nested too deep, has a key twice in an object, or has a number beyond the range of double.
nlohmann::json parse_json(std::string_view text, const std::string& place);

/// Parses a file that must hold a JSON object. Throws InputError likewise, beginning with the path.
nlohmann::json read_json_file(const std::filesystem::path& path);

/// Throws InputError if an output file exists that the command did not write: one that is neither empty nor a JSON
/// object with these keys, which all its outputs have.
/// @param command for the message
void require_earlier_output(const std::filesystem::path& file, const std::vector<std::string>& keys,
                            const std::string& command);

/// A float as the shortest decimal that reads back as the same float: 0.1, not 0.10000000149011612.
nlohmann::json readable(float value);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Conversion of structs of constants to and from JSON; unknown keys are errors.
#pragma once

#include <set>
#include <string>
#include <type_traits>

#include <nlohmann/json.hpp>

#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

namespace splatboost {

/// @param for_each calls its argument as visit(name, field) for every field
template <class ForEach>
nlohmann::json fields_to_json(ForEach&& for_each) {
  nlohmann::json json = nlohmann::json::object();
  for_each([&](const char* name, const auto& field) {
    if constexpr (std::is_same_v<std::remove_cvref_t<decltype(field)>, float>) {
      json[name] = readable(field);
    } else {
      json[name] = field;
    }
  });
  return json;
}

/// Overwrites the fields that the object names. Throws InputError on an unknown key or a value of the wrong type.
/// @param what owner of the constants, for error messages
template <class ForEach>
void fields_from_json(const nlohmann::json& json, const std::string& what, ForEach&& for_each) {
  if (!json.is_object()) throw InputError("config of " + what + ": expected a JSON object");
  std::set<std::string> known;
  for_each([&](const char* name, auto& field) {
    known.insert(name);
    const auto found = json.find(name);
    if (found == json.end()) return;
    read_value(*found, "config of " + what + ": '" + name + "'", field);
  });
  for (const auto& [key, value] : json.items()) {
    if (!known.contains(key)) {
      std::string names;
      for (const std::string& name : known) names += (names.empty() ? "" : ", ") + name;
      throw InputError("config of " + what + ": unknown key '" + key + "'; known keys are " + names);
    }
  }
}

}  // namespace splatboost

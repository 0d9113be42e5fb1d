// SPDX-License-Identifier: Apache-2.0
/// @file How the program knows a backbone.
#pragma once

#include <filesystem>
#include <memory>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "trainer/backbone_api/backbone.h"

namespace splatboost {

/// Each folder of backbones/ that holds a backbone defines one: `BackboneEntry NAME_entry()`.
struct BackboneEntry {
  std::string_view name;  ///< as --backbone takes it
  int iterations;         ///< length of the published run, the default
  /// @param constants of the backbone by field name, over its defaults. Throws InputError on an unknown key, a wrong
  /// type or an impossible value.
  std::unique_ptr<Backbone> (*make)(const BackboneContext& context, const nlohmann::json& constants);
  /// Writes a model that export_model() left in a folder as triangles, .ply or .glb. Null: its primitives are none.
  void (*export_mesh)(const std::filesystem::path& model, const std::filesystem::path& file) = nullptr;
};

/// One for each folder of backbones/ that CMake found.
const std::vector<BackboneEntry>& backbones();

}  // namespace splatboost

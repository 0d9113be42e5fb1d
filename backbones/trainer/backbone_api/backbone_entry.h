// SPDX-License-Identifier: Apache-2.0
/// @file Entry by which the program finds a backbone.
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
  /// @param constants by field name; they override the backbone's defaults. Throws InputError on an unknown key, a
  /// wrong type or an impossible value.
  std::unique_ptr<Backbone> (*make)(const BackboneContext& context, const nlohmann::json& constants);
  /// Writes a model folder of export_model() as triangles, .ply or .glb. Null: the primitives have no triangle form.
  void (*export_mesh)(const std::filesystem::path& model, const std::filesystem::path& file) = nullptr;
  /// Throws InputError if the backbone cannot be trained on this scene; a trained model may still be rendered from its
  /// cameras. Null: it can be trained on any.
  void (*require_trainable)(const Scene& scene) = nullptr;
};

/// One per backbone folder of backbones/ that CMake found.
const std::vector<BackboneEntry>& backbones();

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Finds a backbone and its adapter by name, and plugs the one into the other.
#pragma once

#include <memory>
#include <optional>
#include <string_view>

#include <nlohmann/json.hpp>

#include "registry/boost_settings.h"
#include "trainer/backbone_api/backbone_entry.h"

namespace splatboost::program {

/// Throws InputError naming those there are.
const BackboneEntry& find_backbone(std::string_view name);

/// The settings of a backbone's acceleration: its defaults, or the paper's where "literal" is given and true, overlaid
/// with the given ones, by field name. Throws InputError on an unknown key, a wrong type or an impossible value.
std::unique_ptr<BoostSettings> read_boost_settings(std::string_view backbone, const nlohmann::json& given);
nlohmann::json to_json(BoostSettings& settings);

/// A backbone with the hooks that accelerate it, if any.
struct PluggedBackbone {
  std::unique_ptr<Adapter> adapter;  ///< the backbone holds plain pointers to it
  std::unique_ptr<Backbone> backbone;
  std::optional<float> beta;  ///< of the compact box in use; none: the backbone's own box
  double coarse_until = 0;    ///< share of the run that sees views at half their size
};

/// @param constants of the backbone, over its defaults
/// @param boost of the acceleration; null: the backbone as published
PluggedBackbone make_backbone(std::string_view name, const BackboneContext& context, const nlohmann::json& constants,
                              const nlohmann::json* boost);

}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
/// @file Finds a backbone and its adapter by name, and attaches the adapter to the backbone.
#pragma once

#include <memory>
#include <optional>
#include <string_view>

#include <nlohmann/json.hpp>

#include "registry/boost_settings.h"
#include "trainer/backbone_api/backbone_entry.h"

namespace splatboost::program {

/// Throws InputError if there is none; the message lists the available ones.
const BackboneEntry& find_backbone(std::string_view name);

/// The settings of a backbone's acceleration: its defaults, or the paper's if "literal" is given and true, overridden
/// by the given ones by field name. Throws InputError on an unknown key, a wrong type or an impossible value.
std::unique_ptr<BoostSettings> read_boost_settings(std::string_view backbone, const nlohmann::json& given);
nlohmann::json to_json(BoostSettings& settings);

/// A backbone with the hooks that accelerate it, if any.
struct PluggedBackbone {
  std::unique_ptr<Adapter> adapter;  ///< the backbone holds plain pointers to it
  std::unique_ptr<Backbone> backbone;
  std::optional<float> beta;  ///< of the compact box in use; none: the backbone's own box
  double coarse_until = 0;    ///< share of the run that trains on views at half their size
};

/// @param constants override the backbone's defaults
/// @param boost settings of the acceleration; null: the backbone as published
PluggedBackbone make_backbone(std::string_view name, const BackboneContext& context, const nlohmann::json& constants,
                              const nlohmann::json* boost);

}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
/// @file The one place that knows which backbones there are, and plugs their adapters into them.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "trainer/backbone_api/backbone.h"

namespace splatboost::program {

/// What the training loop does for an accelerated run, next to the adapter's parts.
struct CoarseStart {
  bool coarse = true;         ///< begin with the views at half their size
  double coarse_until = 0.3;  ///< share of the run
  double share() const { return coarse ? coarse_until : 0; }
};

/// All settings of an accelerated run. @tparam Boost settings of the backbone's adapter
template <class Boost>
struct RunBoost : Boost, CoarseStart {};

/// Visits the fields of CoarseStart by name.
template <class Settings, class Visitor>
void for_each_coarse_field(Settings& boost, Visitor& visit) {
  visit("coarse", boost.coarse);
  visit("coarse_until", boost.coarse_until);
}

/// Throws InputError on an impossible value.
void check_coarse(const CoarseStart& boost);

/// A backbone with the hooks that accelerate it, if any.
struct PluggedBackbone {
  std::shared_ptr<void> adapter;  ///< outlives the backbone, which holds plain pointers to it
  std::unique_ptr<Backbone> backbone;
  std::optional<float> beta;  ///< of the compact box in use; none: the backbone's own box
  double coarse_until = 0;    ///< share of the run that sees views at half their size
};

/// What the program needs to know of a backbone. Settings are JSON objects by field name, as --config takes them.
struct BackboneEntry {
  std::string_view name;
  int iterations;  ///< length of the published run, the default
  /// All settings of the acceleration: the defaults overlaid with the given ones. Throws InputError on an unknown
  /// key, a wrong type or an impossible value.
  nlohmann::json (*boost_settings)(const nlohmann::json& given);
  /// @param constants of the backbone, over its defaults
  /// @param boost of the acceleration; null: the backbone as published
  PluggedBackbone (*make)(const BackboneContext& context, const nlohmann::json& constants, const nlohmann::json* boost);
};

const std::vector<BackboneEntry>& backbones();

/// Throws InputError naming those there are.
const BackboneEntry& find_backbone(std::string_view name);

}  // namespace splatboost::program

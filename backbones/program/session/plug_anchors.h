// SPDX-License-Identifier: Apache-2.0
/// @file How the program plugs the adapters of anchor backbones into them.
#pragma once

#include "program/session/registry.h"

namespace splatboost::program {

nlohmann::json scaffold_boost_settings(const nlohmann::json& given);
PluggedBackbone make_plugged_scaffold(const BackboneContext& context, const nlohmann::json& constants,
                                      const nlohmann::json* settings);

nlohmann::json octree_boost_settings(const nlohmann::json& given);
PluggedBackbone make_plugged_octree(const BackboneContext& context, const nlohmann::json& constants,
                                    const nlohmann::json* settings);

}  // namespace splatboost::program

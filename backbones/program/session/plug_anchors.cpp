// SPDX-License-Identifier: Apache-2.0
#include "program/session/plug_anchors.h"

#include "octree_gs/octree_adapter.h"
#include "octree_gs/octree_gs.h"
#include "scaffold_gs/scaffold_adapter.h"
#include "scaffold_gs/scaffold_gs.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_fields.h"

namespace splatboost::program {
namespace {

using Json = nlohmann::json;

using AnchorBoost = RunBoost<ScaffoldBoost>;

/// Visits the fields of the settings by name; the seed is the run's.
template <class Settings, class Visitor>
void for_each_field(Settings& boost, Visitor&& visit) {
  visit("vcd", boost.vcd);
  visit("cb", boost.cb);
  visit("schedule", boost.schedule);
  visit("rates_fall_from", boost.rates_fall_from);
  visit("literal", boost.literal);
  visit("beta", boost.beta);
  visit("tau_d", boost.tau_d);
  visit("views", boost.views);
  visit("tau", boost.tau);
  for_each_coarse_field(boost, visit);
}

AnchorBoost scaffold_defaults() { return {}; }

AnchorBoost octree_defaults() { return {octree_boost(), {}}; }

AnchorBoost boost_from_json(AnchorBoost boost, const Json& given) {
  fields_from_json(given, "boost", [&](auto&& visit) { for_each_field(boost, visit); });
  require(boost.beta > 0 && boost.beta <= 1, "boost: beta must be in (0, 1]");
  require(boost.tau_d >= 0, "boost: tau_d must be at least 0");
  require(boost.views >= 1, "boost: views must be at least 1");
  require(boost.tau > 0 && boost.tau < 1, "boost: tau must be in (0, 1)");
  require(boost.rates_fall_from >= 0 && boost.rates_fall_from < 1, "boost: rates_fall_from must be in [0, 1)");
  check_coarse(boost);
  return boost;
}

Json settings_of(const AnchorBoost& boost) {
  return fields_to_json([&](auto&& visit) { for_each_field(boost, visit); });
}

PluggedBackbone plug(std::unique_ptr<Backbone> backbone, const BackboneContext& context, AnchorBoost boost) {
  boost.seed = context.seed;
  const auto adapter = std::make_shared<ScaffoldAdapter>(boost, context.device);
  PluggedBackbone plugged;
  plugged.backbone = std::move(backbone);
  plugged.beta = adapter->beta();
  plugged.backbone->rasterizer_hook().set_beta(plugged.beta);
  plugged.backbone->set_hooks(adapter.get(), adapter.get());
  plugged.adapter = adapter;
  plugged.coarse_until = boost.share();
  return plugged;
}

}  // namespace

Json scaffold_boost_settings(const Json& given) { return settings_of(boost_from_json(scaffold_defaults(), given)); }

PluggedBackbone make_plugged_scaffold(const BackboneContext& context, const Json& constants, const Json* settings) {
  std::unique_ptr<Backbone> backbone = make_scaffold(context, scaffold_config_from_json(constants));
  if (settings == nullptr) return {nullptr, std::move(backbone), std::nullopt, 0};
  return plug(std::move(backbone), context, boost_from_json(scaffold_defaults(), *settings));
}

Json octree_boost_settings(const Json& given) { return settings_of(boost_from_json(octree_defaults(), given)); }

PluggedBackbone make_plugged_octree(const BackboneContext& context, const Json& constants, const Json* settings) {
  std::unique_ptr<Backbone> backbone = make_octree(context, octree_config_from_json(constants));
  if (settings == nullptr) return {nullptr, std::move(backbone), std::nullopt, 0};
  return plug(std::move(backbone), context, boost_from_json(octree_defaults(), *settings));
}

}  // namespace splatboost::program

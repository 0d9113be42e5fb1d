// SPDX-License-Identifier: Apache-2.0
#include "cli/plug_anchors.h"

#include <type_traits>

#include "common/input_error.h"
#include "common/json_fields.h"
#include "octree_gs/octree_adapter.h"
#include "octree_gs/octree_gs.h"
#include "scaffold_gs/scaffold_adapter.h"
#include "scaffold_gs/scaffold_gs.h"

namespace splatboost::cli {
namespace {

using Json = nlohmann::json;

/// Visits the fields of the settings by name; the seed is the run's, the number of slots the backbone's.
template <class Settings, class Visitor>
void for_each_field(Settings& boost, Visitor&& visit) {
  if constexpr (std::is_base_of_v<OctreeBoost, Settings>) visit("level_aware", boost.level_aware);
  visit("vcd", boost.vcd);
  visit("cb", boost.cb);
  visit("beta", boost.beta);
  visit("tau_d", boost.tau_d);
  visit("views", boost.views);
  visit("tau", boost.tau);
  for_each_coarse_field(boost, visit);
}

void check(const ScaffoldBoost& boost) {
  require(boost.beta > 0 && boost.beta <= 1, "boost: beta must be in (0, 1]");
  require(boost.tau_d >= 0, "boost: tau_d must be at least 0");
  require(boost.views >= 1, "boost: views must be at least 1");
  require(boost.tau > 0 && boost.tau < 1, "boost: tau must be in (0, 1)");
}

/// Octree-GS's progressive training is a coarse start of its own.
template <class Boost>
constexpr bool kStartsCoarse = !std::is_same_v<Boost, OctreeBoost>;

template <class Boost>
RunBoost<Boost> boost_from_json(const Json& given) {
  RunBoost<Boost> boost;
  boost.coarse = kStartsCoarse<Boost>;
  fields_from_json(given, "boost", [&](auto&& visit) { for_each_field(boost, visit); });
  check(boost);
  check_coarse(boost);
  return boost;
}

template <class Boost>
Json settings_of(const Json& given) {
  const RunBoost<Boost> boost = boost_from_json<Boost>(given);
  return fields_to_json([&](auto&& visit) { for_each_field(boost, visit); });
}

template <class Adapter, class Boost>
PluggedBackbone plug(std::unique_ptr<Backbone> backbone, const BackboneContext& context, RunBoost<Boost> boost) {
  boost.seed = context.seed;
  const auto adapter = std::make_shared<Adapter>(boost, context.device);
  PluggedBackbone plugged;
  plugged.backbone = std::move(backbone);
  plugged.beta = adapter->beta();
  plugged.backbone->rasterizer_hook().set_beta(plugged.beta);
  plugged.backbone->set_hooks(adapter.get(), nullptr);
  plugged.adapter = adapter;
  plugged.coarse_until = boost.share();
  return plugged;
}

}  // namespace

Json scaffold_boost_settings(const Json& given) { return settings_of<ScaffoldBoost>(given); }

PluggedBackbone make_plugged_scaffold(const BackboneContext& context, const Json& constants, const Json* settings) {
  std::unique_ptr<Backbone> backbone = make_scaffold(context, scaffold_config_from_json(constants));
  if (settings == nullptr) return {nullptr, std::move(backbone), std::nullopt, 0};
  return plug<ScaffoldAdapter>(std::move(backbone), context, boost_from_json<ScaffoldBoost>(*settings));
}

Json octree_boost_settings(const Json& given) { return settings_of<OctreeBoost>(given); }

PluggedBackbone make_plugged_octree(const BackboneContext& context, const Json& constants, const Json* settings) {
  const OctreeConfig config = octree_config_from_json(constants);
  std::unique_ptr<Backbone> backbone = make_octree(context, config);
  if (settings == nullptr) return {nullptr, std::move(backbone), std::nullopt, 0};
  RunBoost<OctreeBoost> boost = boost_from_json<OctreeBoost>(*settings);
  boost.slots_per_anchor = static_cast<std::size_t>(config.n_offsets);
  return plug<OctreeAdapter>(std::move(backbone), context, boost);
}

}  // namespace splatboost::cli

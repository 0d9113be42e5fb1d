// SPDX-License-Identifier: Apache-2.0
#include "program/session/registry.h"

#include "dropgaussian/dropgaussian.h"
#include "dropgaussian/dropgaussian_adapter.h"
#include "mip_splatting/mip_splatting.h"
#include "mip_splatting/mip_splatting_adapter.h"
#include "octree_gs/octree_gs.h"
#include "program/session/plug_anchors.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_fields.h"
#include "vanilla/vanilla.h"
#include "vanilla/vanilla_adapter.h"

namespace splatboost::program {
namespace {

using Json = nlohmann::json;

/// Visits the fields of the settings by name; the seed is the run's.
template <class Settings, class Visitor>
void for_each_field(Settings& boost, Visitor&& visit) {
  visit("vcd", boost.vcd);
  visit("vcp", boost.vcp);
  visit("cb", boost.cb);
  visit("absgrad", boost.absgrad);
  visit("schedule", boost.schedule);
  visit("beta", boost.beta);
  visit("tau_d", boost.tau_d);
  visit("views", boost.views);
  visit("tau", boost.tau);
  visit("lambda_dssim", boost.lambda_dssim);
  visit("gradient_threshold", boost.gradient_threshold);
  visit("gradient_abs_threshold", boost.gradient_abs_threshold);
  visit("percent_dense", boost.percent_dense);
  visit("densify_from", boost.densify_from);
  visit("densify_until", boost.densify_until);
  visit("densify_interval", boost.densify_interval);
  visit("late_prune_from", boost.late_prune_from);
  visit("late_prune_interval", boost.late_prune_interval);
  visit("late_min_opacity", boost.late_min_opacity);
  visit("late_max_score", boost.late_max_score);
  for_each_coarse_field(boost, visit);
}

/// @param defaults of the backbone's acceleration
RunBoost<VanillaBoost> boost_from_json(const VanillaBoost& defaults, const Json& given) {
  RunBoost<VanillaBoost> boost{defaults, {}};
  fields_from_json(given, "boost", [&](auto&& visit) { for_each_field(boost, visit); });
  require(boost.beta > 0 && boost.beta <= 1, "boost: beta must be in (0, 1]");
  require(boost.tau_d >= 0, "boost: tau_d must be at least 0");
  require(boost.views >= 1, "boost: views must be at least 1");
  require(boost.tau > 0 && boost.tau < 1, "boost: tau must be in (0, 1)");
  require(boost.lambda_dssim >= 0 && boost.lambda_dssim <= 1, "boost: lambda_dssim must be in [0, 1]");
  require(boost.gradient_threshold >= 0, "boost: gradient_threshold must be at least 0");
  require(boost.gradient_abs_threshold >= 0, "boost: gradient_abs_threshold must be at least 0");
  require(boost.percent_dense >= 0, "boost: percent_dense must be at least 0");
  require(boost.densify_interval >= 1, "boost: densify_interval must be at least 1");
  require(boost.late_prune_from >= 0, "boost: late_prune_from must be at least 0");
  require(boost.late_prune_interval >= 1, "boost: late_prune_interval must be at least 1");
  check_coarse(boost);
  return boost;
}

/// A backbone of explicit Gaussians: all share the settings of their acceleration, with defaults of their own.
/// @tparam kDefaults makes these, kConfig reads the backbone's constants, kMake makes the backbone
template <auto kDefaults, auto kConfig, auto kMake, class Adapter>
BackboneEntry gaussian_entry(std::string_view name, int iterations) {
  return {name, iterations,
          [](const Json& given) {
            const RunBoost<VanillaBoost> boost = boost_from_json(kDefaults(), given);
            return fields_to_json([&](auto&& visit) { for_each_field(boost, visit); });
          },
          [](const BackboneContext& context, const Json& constants, const Json* settings) {
            PluggedBackbone plugged;
            plugged.backbone = kMake(context, kConfig(constants));
            if (settings) {
              RunBoost<VanillaBoost> boost = boost_from_json(kDefaults(), *settings);
              boost.seed = context.seed;
              const auto adapter = std::make_shared<Adapter>(boost, context.device);
              plugged.beta = adapter->beta();
              plugged.backbone->rasterizer_hook().set_beta(plugged.beta);
              plugged.backbone->set_hooks(adapter.get(), adapter.get());
              plugged.adapter = adapter;
              plugged.coarse_until = boost.share();
            }
            return plugged;
          }};
}

VanillaBoost paper_boost() { return {}; }

}  // namespace

void check_coarse(const CoarseStart& boost) {
  require(boost.coarse_until >= 0 && boost.coarse_until <= 1, "boost: coarse_until must be in [0, 1]");
}

const std::vector<BackboneEntry>& backbones() {
  static const std::vector<BackboneEntry> entries = {
      gaussian_entry<paper_boost, vanilla_config_from_json, make_vanilla, VanillaAdapter>("vanilla",
                                                                                          kPublishedIterations),
      gaussian_entry<paper_boost, mip_splatting_config_from_json, make_mip_splatting, MipSplattingAdapter>(
          "mip-splatting", kPublishedIterations),
      gaussian_entry<dropgaussian_boost, dropgaussian_config_from_json, make_dropgaussian, DropGaussianAdapter>(
          "dropgaussian", kDropGaussianIterations),
      {"scaffold-gs", kPublishedIterations, scaffold_boost_settings, make_plugged_scaffold},
      {"octree-gs", kOctreeIterations, octree_boost_settings, make_plugged_octree},
  };
  return entries;
}

const BackboneEntry& find_backbone(std::string_view name) {
  std::string names;
  for (const BackboneEntry& entry : backbones()) {
    if (entry.name == name) return entry;
    names += (names.empty() ? "" : ", ") + std::string(entry.name);
  }
  throw InputError("--backbone: no '" + std::string(name) + "' here; there are: " + names);
}

}  // namespace splatboost::program

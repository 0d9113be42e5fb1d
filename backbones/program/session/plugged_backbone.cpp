// SPDX-License-Identifier: Apache-2.0
#include "program/session/plugged_backbone.h"

#include <string>
#include <variant>

#include "splatboost/clearance.h"
#include "trainer/dataset/scene_depths.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_fields.h"

namespace splatboost::program {
namespace {

using Json = nlohmann::json;

constexpr const char* kAbsolute = "absolute_distances";  ///< of backbones with lengths in world units, as published

/// Calls visitor(name, value) for each setting, as fields_to_json() and fields_from_json() need it.
template <class Visitor>
void visit_settings(BoostSettings& settings, Visitor&& visitor) {
  for (const BoostSettings::Setting& setting : settings.settings()) {
    std::visit([&](auto* value) { visitor(setting.name, *value); }, setting.value);
  }
}

}  // namespace

const BackboneEntry& find_backbone(std::string_view name) {
  std::string names;
  for (const BackboneEntry& entry : backbones()) {
    if (entry.name == name) return entry;
    names += (names.empty() ? "" : ", ") + std::string(entry.name);
  }
  throw InputError("--backbone: unknown backbone '" + std::string(name) + "'; available: " + names);
}

std::unique_ptr<BoostSettings> read_boost_settings(std::string_view backbone, const Json& given) {
  find_backbone(backbone);
  bool literal = false;
  if (given.is_object() && given.contains("literal")) read_value(given["literal"], "boost: literal", literal);
  std::unique_ptr<BoostSettings> settings = find_adapter(backbone).make_settings(literal);
  fields_from_json(given, "boost", [&](auto&& visitor) { visit_settings(*settings, visitor); });
  try {
    settings->validate();
  } catch (const ArgumentError& error) {
    throw InputError("boost: " + std::string(error.what()));
  }
  return settings;
}

Json to_json(BoostSettings& settings) {
  return fields_to_json([&](auto&& visitor) { visit_settings(settings, visitor); });
}

namespace {

/// A backbone stops gathering statistics at its own densify_until, so a later one set by the user could not take
/// effect.
void check_end_of_growth(std::string_view name, const Json& constants, const Json& settings) {
  const auto until = [](const Json& values) { return values.value("densify_until", 0); };
  const int wanted = until(settings), own = until(constants);
  if (wanted <= own || wanted == until(to_json(*read_boost_settings(name, {{"literal", settings["literal"]}})))) return;
  throw InputError("boost: densify_until " + std::to_string(wanted) + " is after the backbone's, " +
                   std::to_string(own) + ": set densify_until of the backbone too");
}

/// Late pruning must not begin before growth has ended, because it would remove what was just made. Adapters that do
/// not decide when growth ends (of convexes, and without VCD) do not know this.
Json after_growth(Json settings, const Json& constants) {
  const int end = constants.value("densify_until", 0);
  const bool decides = settings.contains("densify_until") && settings.value("vcd", true);
  if (!decides && settings.value("late_prune_from", end) < end) {
    settings["late_prune_from"] = end;
  }
  return settings;
}

/// What the adapter needs to know about the scene.
Json with_scene(Json settings, const Scene& scene) {
  // Where free space around the cameras is not known, it is the resets of opacities that clear it.
  if (settings.value("min_clearance", 0.0) > 0) {
    settings["random_points"] = !points_show_surfaces(scene.points.positions);
  }
  if (settings.contains("training_views")) settings["training_views"] = scene.train.size();
  if (settings.value("rate_by_depth", false) && scene.extent > 0) {
    settings["depth_ratio"] = typical_depth(scene) / static_cast<double>(scene.extent);
  }
  return settings;
}

/// Lengths that are not for the scene cost quality; a user's own choice stays.
Json with_scaled_lengths(Json constants) {
  if (!constants.is_object()) constants = Json::object();
  if (!constants.contains(kAbsolute)) constants[kAbsolute] = false;
  return constants;
}

/// No view is more recent than others if all are there from the beginning.
Json with_arrival(Json settings, bool views_arrive) {
  if (!views_arrive && settings.contains("recent_share")) settings["recent_share"] = 0.0;
  return settings;
}

}  // namespace

PluggedBackbone make_backbone(std::string_view name, const BackboneContext& context, const Json& constants,
                              const Json* boost) {
  PluggedBackbone plugged;
  const bool scales = boost != nullptr && read_boost_settings(name, *boost)->scales_lengths();
  plugged.backbone = find_backbone(name).make(context, scales ? with_scaled_lengths(constants) : constants);
  if (boost != nullptr) {
    const Json own = plugged.backbone->config(), given = to_json(*read_boost_settings(name, *boost));
    check_end_of_growth(name, own, given);
    const Json of_run = with_arrival(with_scene(after_growth(given, own), context.scene), context.views_arrive);
    const std::unique_ptr<BoostSettings> settings = read_boost_settings(name, of_run);
    plugged.adapter = settings->make_adapter(context.seed, context.device);
    plugged.beta = plugged.adapter->beta();
    plugged.coarse_until = settings->coarse_share();
    plugged.backbone->rasterizer_hook().set_beta(plugged.beta);
    plugged.backbone->set_hooks(plugged.adapter.get(), plugged.adapter.get());
  }
  return plugged;
}

}  // namespace splatboost::program

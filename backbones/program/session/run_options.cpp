// SPDX-License-Identifier: Apache-2.0
#include "program/session/run_options.h"

#include "program/session/plugged_backbone.h"
#include "trainer/support/json_values.h"

namespace splatboost::program {

using Json = nlohmann::json;

Json read_settings_file(const std::filesystem::path& path) {
  Json settings = read_json_file(path);
  if (settings.contains("backbone") && settings["backbone"].is_string()) {
    settings["backbone"] = {{"name", settings["backbone"]}};
  }
  if (settings.contains("boost") && settings["boost"].is_boolean()) {
    settings["boost"] = {{"enabled", settings["boost"]}};
  }
  return settings;
}

Json boost_settings(const RunOptions& options) {
  Json settings = options.boost_settings;
  if (options.beta) settings["beta"] = *options.beta;
  if (options.tau_d) settings["tau_d"] = *options.tau_d;
  if (options.views) settings["views"] = *options.views;
  if (options.literal) settings["literal"] = true;
  if (options.no_vcd) settings["vcd"] = false;
  if (options.no_vcp) settings["vcp"] = false;
  if (options.no_cb) settings["cb"] = false;
  if (options.no_absgrad) settings["absgrad"] = false;
  if (options.no_schedule) settings["schedule"] = false;
  if (options.no_coarse) settings["coarse"] = false;
  return to_json(*read_boost_settings(options.backbone, settings));
}

void require_source(const RunOptions& options) {
  if (options.scene.source.empty()) {
    throw UsageError("no scene given: name its folder with -s/--source; 'splatboost synth DIR' makes one to try");
  }
}

void require_model(const RunOptions& options, const std::string& kind) {
  if (options.model.empty()) throw UsageError("no " + kind + " folder given: name it with -m/--model");
}

}  // namespace splatboost::program

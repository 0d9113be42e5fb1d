// SPDX-License-Identifier: Apache-2.0
#include "program/command_line/saved_model_options.h"

#include <filesystem>
#include <system_error>

#include "program/command_line/shared_options.h"
#include "program/session/model_folder.h"

namespace splatboost::program {
namespace {

/// Adds, for files only, the options in config.json that the command itself does not have.
void add_recorded_options(OptionSet& set, RunOptions& options) {
  set.files_only();
  add_data_options(set, options);
  add_training_options(set, options, true);
}

}  // namespace

void add_saved_model_options(OptionSet& set, RunOptions& options) {
  add_source_option(set, options);
  add_model_option(set, options, "model folder of a run");
  set.add("--iteration", options.iteration, kIterationHelp, false)->type_name("N")->capture_default_str();
}

void add_drawing_options(OptionSet& set, RunOptions& options) {
  set.set_group("Output");
  set.add("--beta", options.beta, "compact box instead of the one used in training, in (0, 1]; 1: exact", false)
      ->type_name("X");
  add_machine_options(set, options);
  set.set_group("Output");
  set.add("--quiet", options.quiet, "no notes", false);
  add_recorded_options(set, options);
  add_lpips_option(set, options);
}

void add_measuring_options(OptionSet& set, RunOptions& options) {
  add_machine_options(set, options);
  add_lpips_option(set, options);
  set.add("--quiet", options.quiet, "no notes", false);
  add_recorded_options(set, options);
}

SavedModel find_saved_model(OptionSet& set, RunOptions& options) {
  require_model(options);
  const nlohmann::json config = read_config(options.model);
  apply_settings(config, (options.model / "config.json").string(), set, options);
  check_options(set, options);
  std::error_code ignored;
  // Keyframes are written before anything is measured. Those of a complete run may have been moved.
  require(set.given("source") || !config.contains("slam") || std::filesystem::exists(options.scene.source, ignored) ||
              is_file(options.model / "results.json"),
          options.model.string() + ": the run did not finish; run splatboost slam again, which has no checkpoints");
  require(set.given("source") || std::filesystem::exists(options.scene.source, ignored),
          options.scene.source.string() + ": does not exist; the run in " + options.model.string() +
              " was trained on it: name its new place with --source");
  SavedModel model{saved_model(options.model, options.iteration), trained_beta(options.model, config)};
  if (options.beta) model.beta = static_cast<float>(*options.beta);
  return model;
}

}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
/// @file One run from scene to full output folder: what train does once and compare twice.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "program/session/chosen_device.h"
#include "program/session/options.h"
#include "program/session/plugged_backbone.h"
#include "trainer/dataset/scene.h"
#include "trainer/evaluation/metrics.h"
#include "trainer/evaluation/results.h"
#include "trainer/report/report.h"

namespace splatboost::program {

/// What runs share: read once.
struct Workbench {
  Scene scene;
  std::unique_ptr<ChosenDevice> device;
  std::unique_ptr<Lpips> lpips;  ///< null unless asked for
};

/// Reads the scene and readies the device; prints what the data reader has to note.
Workbench make_workbench(const RunOptions& options);

struct RunOutcome {
  int interrupted_by = 0;  ///< signal; the rest is then empty
  ReportRun run;
  std::vector<ReportView> views;
};

/// "boosted" or "baseline": the name of a run in reports and, in a comparison, of its folder.
std::string run_label(bool boost);

/// Builds the backbone of a run and lets it go again: throws InputError on constants that it refuses.
void check_backbone(Workbench& bench, const RunOptions& options, bool boost);

/// Trains, evaluates and fills `folder`.
/// @param take_folder called once nothing can refuse the run any more, before anything is written; leaves the folder to
/// the run
RunOutcome run_once(Workbench& bench, const OptionSet& set, const RunOptions& options, bool boost,
                    const std::filesystem::path& folder, const std::string& command,
                    const std::function<void()>& take_folder);

/// What results say of any run that just ended: options, machine, time and place. What it made is to be filled in.
/// @param command as typed
Results results_of_run(const RunOptions& options, bool boost, const Scene& scene, ChosenDevice& device,
                       const std::string& command);

/// Measures the model at the end of a run and writes the pictures, the report and, last, results.json.
/// @param trained what kTrainingFile holds
RunOutcome measure_run(Workbench& bench, Backbone& backbone, const std::filesystem::path& folder, Results trained);

/// Writes results.json, or kTrainingFile.
void write_results(const std::filesystem::path& path, const Results& results);

/// The rows of one or two runs as text columns.
std::string results_table(const Results& results);

/// Runs a subcommand's backbone without training: for rendering and evaluation of a saved model.
PluggedBackbone load_model(Workbench& bench, const RunOptions& options, const std::filesystem::path& saved,
                           std::optional<float> beta);

/// What the shell reports of a program ended by this signal.
int exit_code_of_signal(int signal_number);

}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
/// @file One run from scene to full output folder: what train does once and compare twice.
#pragma once

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
};

/// Trains, evaluates and fills `folder`, which was taken before, except for its report.
/// @param label of the report and, in a comparison, of the progress line
RunOutcome run_once(Workbench& bench, const OptionSet& set, const RunOptions& options, bool boost,
                    const std::filesystem::path& folder, const std::string& label, const std::string& command);

/// Saves the photos that measured renders are compared with; the views of a report.
std::vector<ReportView> write_truth(const Scene& scene, const std::filesystem::path& folder);

/// The rows of one or two runs as text columns.
std::string results_table(const Results& results);

/// Runs a subcommand's backbone without training: for rendering and evaluation of a saved model.
PluggedBackbone load_model(Workbench& bench, const RunOptions& options, const std::filesystem::path& saved,
                           std::optional<float> beta);

/// What the shell reports of a program ended by this signal.
int exit_code_of_signal(int signal_number);

}  // namespace splatboost::program

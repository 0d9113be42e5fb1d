// SPDX-License-Identifier: Apache-2.0
/// @file One run, from the scene to the complete output folder: train does one, compare two.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "program/session/chosen_device.h"
#include "program/session/plugged_backbone.h"
#include "program/session/run_options.h"
#include "trainer/dataset/scene.h"
#include "trainer/evaluation/metrics.h"
#include "trainer/evaluation/results.h"
#include "trainer/report/report.h"

namespace splatboost::program {

/// What the runs of a command share; read only once.
struct Workbench {
  Scene scene;
  std::optional<PointCloud> triangulated;  ///< for Scene::more_points, once a run needed them
  double triangulation_seconds = 0;
  std::uint64_t triangulation_peak_bytes = 0;  ///< the process's memory
  std::unique_ptr<ChosenDevice> device;
  std::unique_ptr<Lpips> lpips;  ///< null unless asked for
};

/// Throws InputError, naming the view, if it is too small for --lpips.
void require_lpips_size(const std::string& view, int width, int height);

/// Reads the scene and prepares the device; prints the notes of the data reader.
Workbench make_workbench(const RunOptions& options);

struct RunOutcome {
  int interrupted_by = 0;            ///< signal number; 0: not interrupted
  int iteration = 0;                 ///< the last one of an interrupted run
  std::filesystem::path checkpoint;  ///< written on interruption; empty: the model is complete, but not measured
  ReportRun run;                     ///< of a run that was not interrupted, like the views
  std::vector<ReportView> views;
};

/// "boosted" or "baseline": the name of a run in reports and, in a comparison, of its folder.
std::string run_label(bool boost);

/// The config.json that a run will write, with the recorded options (OptionSet::record()). Creates and discards its
/// backbone, so that constants that it refuses throw InputError early.
std::string config_of_run(Workbench& bench, const nlohmann::json& recorded, const RunOptions& options, bool boost);

/// Trains, evaluates and fills `folder`. options.resume may also be a folder of checkpoints: see TrainOptions.
/// @param recorded the recorded options (OptionSet::record())
/// @param take_folder called with config.json after all checks that may refuse the run, before anything is written;
/// prepares the folder for the run
RunOutcome run_once(Workbench& bench, const nlohmann::json& recorded, const RunOptions& options, bool boost,
                    const std::filesystem::path& folder, const std::string& command,
                    const std::function<void(const std::string&)>& take_folder);

/// The results common to all runs that just ended: options, machine, time and scene. The caller fills in the rest.
/// @param command as typed
Results results_of_run(const RunOptions& options, bool boost, const Scene& scene, ChosenDevice& device,
                       const std::string& command);

/// The results of a run that has trained to its end in this folder, even if it was killed while it measured; none if
/// there is no such run.
std::optional<Results> trained_results(const std::filesystem::path& folder);

/// Measures the model at the end of a run and writes the pictures, the report and, last, results.json.
/// @param trained contents of kTrainingFile
RunOutcome measure_run(Workbench& bench, Backbone& backbone, const std::filesystem::path& folder, Results trained);

/// The same for the model of such a run, saved in its folder.
RunOutcome measure_saved_run(Workbench& bench, const RunOptions& options, const std::filesystem::path& folder,
                             Results trained);

/// Whether times measured on this device can be compared with those of the results.
bool is_machine_of(const Results& results, ChosenDevice& device);

/// Reads results.json, or kTrainingFile; throws InputError naming the file.
Results read_results(const std::filesystem::path& path);

/// Writes results.json, or kTrainingFile.
void write_results(const std::filesystem::path& path, const Results& results);

/// The rows of a run as text columns.
std::string results_table(const Results& results);

/// Creates the backbone and loads a saved model into it, for rendering and measuring.
PluggedBackbone load_model(Workbench& bench, const RunOptions& options, const std::filesystem::path& saved,
                           std::optional<float> beta);

/// Size of the files of a saved model.
std::uint64_t model_bytes(const std::filesystem::path& saved);

/// Tells how to go on with an interrupted run. @param command that does it @return the exit status
int end_interrupted(const RunOutcome& outcome, const std::string& command);

/// The exit status that a shell reports for a program ended by this signal.
int exit_code_of_signal(int signal_number);

}  // namespace splatboost::program

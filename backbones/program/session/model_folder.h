// SPDX-License-Identifier: Apache-2.0
/// @file The output folder of a run: checking, preparing, writing and reading it. docs/formats.md describes the layout.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "program/session/plugged_backbone.h"
#include "program/session/run_options.h"
#include "trainer/dataset/scene.h"
#include "trainer/support/atomic_file.h"

namespace splatboost::program {

/// Left beside the model between training and measuring: results.json without its quality part and without the model
/// size. It is written before the final model, so that no final model exists without it.
inline constexpr char kTrainingFile[] = "training.json";

/// Throws InputError unless the folder is new, empty or that of a SplatBoost run. Working files that a killed command
/// left behind do not count.
void require_ours_or_empty(const std::filesystem::path& folder);

/// Throws InputError if the folder is that of a run and holds, among the results that take_model_folder() deletes for a
/// new run, a file that no run writes.
void require_only_results(const std::filesystem::path& folder);

/// Whether the folder is that of a SplatBoost run or comparison.
bool holds_run(const std::filesystem::path& folder);

/// Throws InputError if an input file of the run, or `more`, is among the results in the folder, which
/// take_model_folder() deletes.
void require_inputs_elsewhere(const std::filesystem::path& folder, const RunOptions& options,
                              const std::filesystem::path& more = {});

/// Throws InputError if the folder holds a comparison: a run in it would leave the two runs of the comparison there.
/// Calls require_no_run_of_comparison().
void require_no_comparison(const std::filesystem::path& folder);

/// Throws InputError if the folder is one of the two runs of a finished comparison, which compare.json describes.
void require_no_run_of_comparison(const std::filesystem::path& folder);

/// Throws InputError unless the folder is that of a comparison.
void require_comparison(const std::filesystem::path& folder);

/// Throws InputError, naming a difference, if config.json in the folder is that of another run than this text. A folder
/// without one has no run yet.
void require_same_run(const std::filesystem::path& folder, const std::string& config);

/// Creates the folder, or takes over that of an earlier SplatBoost run: its results are deleted, its checkpoints kept.
/// This is the first step of a run that changes anything, so all checks that may refuse the run come before it. Throws
/// InputError if the folder holds anything else, or if another process is using it.
/// @param resumed config.json of a run that resumes from a checkpoint in the folder: the results there are kept if they
/// are of the same run; empty: a new run
/// @return a lock to hold while the run writes into the folder
FolderLock take_model_folder(const std::filesystem::path& folder, const std::string& resumed = {});

/// The text of config.json: the options, the constants in use, and what viewers need to know of the training. Throws
/// InputError on a path that is not UTF-8.
/// @param recorded the recorded options (OptionSet::record())
/// @param plugged the run's backbone; null: a comparison, which has two
/// @param data of the run, whose checksums identify it; null: not complete yet
std::string config_text(const nlohmann::json& recorded, const RunOptions& options, bool boost,
                        const PluggedBackbone* plugged, const Scene* data = nullptr);

void write_config(const std::filesystem::path& folder, const std::string& text);

/// Writes cameras.json in the format of 3DGS, which viewers read: test views, then training views, with the extra key
/// "split".
void write_cameras(const std::filesystem::path& folder, const Scene& scene);

/// Reads config.json of a run; throws InputError if there is none. The source of a run of slam is the keyframes in the
/// folder, if they are there, wherever they were written.
nlohmann::json read_config(const std::filesystem::path& folder);

/// Whether a scene is that of the run with this config.json: by the checksums of its data, which may have moved, or by
/// its path if the config has none (slam, earlier versions).
bool is_scene_of_run(const nlohmann::json& config, const std::filesystem::path& source, const Scene& scene);

/// β the model in the folder was trained with, by its config; none: the backbone's own box.
std::optional<float> trained_beta(const std::filesystem::path& folder, const nlohmann::json& config);

/// Folder of the model saved at `iteration`, or of the last one if it is 0. Throws InputError if there is none, as in
/// the folder of a comparison.
std::filesystem::path saved_model(const std::filesystem::path& folder, int iteration);

/// The iteration in the name of such a folder; -1 if it has another name.
int saved_iteration(const std::filesystem::path& saved);

}  // namespace splatboost::program

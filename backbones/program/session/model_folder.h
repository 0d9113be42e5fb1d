// SPDX-License-Identifier: Apache-2.0
/// @file The output folder of a run: what is ours, what a run finds there, what it leaves. docs/formats.md has the
/// layout.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "program/session/options.h"
#include "program/session/plugged_backbone.h"
#include "trainer/dataset/scene.h"
#include "trainer/support/atomic_file.h"

namespace splatboost::program {

/// What training leaves beside the model until it is measured: results.json without its quality part and the model's
/// size. It is written before the model, so that no model at its end is without it.
inline constexpr char kTrainingFile[] = "training.json";

/// Throws InputError unless the folder is new, empty or ours. What a killed command left in a new folder does not
/// count.
void require_ours_or_empty(const std::filesystem::path& folder);

/// Makes the folder, or takes one over that a run of ours left: its results go, its checkpoints stay. This is the first
/// step of a run that changes anything: whatever can refuse the run comes before. Throws InputError on a folder that
/// holds anything else, or in which another process works.
/// @param keep_results the run goes on with that of the folder
/// @return to be held while the run writes into the folder
FolderLock take_model_folder(const std::filesystem::path& folder, bool keep_results);

/// The text of config.json: the options, the constants in use, and what a viewer must know of the training. Throws
/// InputError on a path that cannot be written down.
/// @param plugged the run's backbone; null: of a comparison, which has two
std::string config_text(const OptionSet& set, const RunOptions& options, bool boost, const PluggedBackbone* plugged);

void write_config(const std::filesystem::path& folder, const std::string& text);

/// cameras.json in 3DGS's form, which viewers read: test views, then training views, with "split" as one key more.
void write_cameras(const std::filesystem::path& folder, const Scene& scene);

/// config.json of a run; throws InputError where there is none.
nlohmann::json read_config(const std::filesystem::path& folder);

/// β the model was trained with; none: the backbone's own box.
std::optional<float> trained_beta(const nlohmann::json& config);

/// Folder of the model saved at `iteration`, or of the last one if it is 0. Throws InputError where there is none.
std::filesystem::path saved_model(const std::filesystem::path& folder, int iteration);

/// The iteration in such a folder's name.
int saved_iteration(const std::filesystem::path& saved);

}  // namespace splatboost::program

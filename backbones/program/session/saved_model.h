// SPDX-License-Identifier: Apache-2.0
/// @file The model of an earlier run: options of the commands that open one, and the opened model.
#pragma once

#include <filesystem>
#include <optional>

#include "program/session/options.h"
#include "program/session/run.h"

namespace splatboost::program {

/// -s, -m and --iteration.
void add_saved_model_options(OptionSet& set, RunOptions& options);

/// --beta, the machine options and --quiet; all other settings of the run come from its config.json only.
void add_drawing_options(OptionSet& set, RunOptions& options);
/// The same for commands that measure: with --lpips, without --beta.
void add_measuring_options(OptionSet& set, RunOptions& options);

struct SavedModel {
  std::filesystem::path folder;  ///< folder of the saved iteration
  std::optional<float> beta;     ///< --beta, or the one it was trained with; none: the backbone's own box
};

/// Reads the settings of the run in --model, which the command line overrides. Throws InputError if there is no such
/// run or model.
SavedModel find_saved_model(OptionSet& set, RunOptions& options);

/// A model ready to render, with its scene and its device. It cannot be copied or moved because the backbone refers to
/// both.
class OpenModel {
 public:
  OpenModel(const SavedModel& model, const RunOptions& options);
  OpenModel(const OpenModel&) = delete;
  OpenModel& operator=(const OpenModel&) = delete;

  Workbench& bench() { return bench_; }
  const Scene& scene() const { return bench_.scene; }
  Backbone& backbone() { return *plugged_.backbone; }

 private:
  Workbench bench_;
  PluggedBackbone plugged_;
};

}  // namespace splatboost::program

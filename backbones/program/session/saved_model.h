// SPDX-License-Identifier: Apache-2.0
/// @file The model of an earlier run: the options of commands that open one, and what they get.
#pragma once

#include <filesystem>
#include <optional>

#include "program/session/options.h"
#include "program/session/run.h"

namespace splatboost::program {

/// -s, -m and --iteration.
void add_saved_model_options(OptionSet& set, RunOptions& options);

/// --beta, the machine's options and --quiet; what else config.json of the run holds is taken from there alone.
void add_drawing_options(OptionSet& set, RunOptions& options);
/// The same of a command that measures: --lpips, but no --beta.
void add_measuring_options(OptionSet& set, RunOptions& options);

struct SavedModel {
  std::filesystem::path folder;  ///< of the iteration
  std::optional<float> beta;     ///< that the model was trained with, or --beta; none: the backbone's own box
};

/// Takes the settings of the run in --model, under those of the command line. Throws InputError where there is no such
/// run or model.
SavedModel find_saved_model(OptionSet& set, RunOptions& options);

/// The model ready to draw, with its scene and its device. The backbone refers to the other two, so this stays where it
/// is.
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

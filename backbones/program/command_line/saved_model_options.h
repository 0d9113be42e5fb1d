// SPDX-License-Identifier: Apache-2.0
/// @file Options of the commands that open the model of an earlier run.
#pragma once

#include "program/command_line/option_set.h"
#include "program/session/run_options.h"
#include "program/session/saved_model.h"

namespace splatboost::program {

/// -s, -m and --iteration.
void add_saved_model_options(OptionSet& set, RunOptions& options);

/// --beta, the machine options and --quiet; all other settings of the run come from its config.json only.
void add_drawing_options(OptionSet& set, RunOptions& options);
/// The same for commands that measure: with --lpips, without --beta.
void add_measuring_options(OptionSet& set, RunOptions& options);

/// Reads the settings of the run in --model, which the command line overrides. Throws InputError if there is no such
/// run or model.
SavedModel find_saved_model(OptionSet& set, RunOptions& options);

}  // namespace splatboost::program

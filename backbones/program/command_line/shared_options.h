// SPDX-License-Identifier: Apache-2.0
/// @file The options that subcommands share, from the command line and from --config files.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "program/command_line/option_set.h"
#include "program/session/run_options.h"

namespace splatboost::program {

inline constexpr char kResolutionHelp[] =
    "1, 2, 4, 8: divisor; larger: width in px; -1: full, at most 1600 px wide [-1]";
inline constexpr char kIterationHelp[] = "model saved at this iteration; 0: the last";
inline constexpr char kImagesHelp[] = "image folder of a COLMAP scene [images], or of a Nerfies capture [rgb/1x]";
inline constexpr char kFrameTimesHelp[] = "COLMAP: the last number in an image name is the frame, which sets the time";
inline constexpr char kFramesHelp[] = "number of frames of each camera of a rig of videos; 0: all [24]";

void add_source_option(OptionSet& set, RunOptions& options);
void add_model_option(OptionSet& set, RunOptions& options, const std::string& help);
void add_data_options(OptionSet& set, RunOptions& options);
/// @param choose_boost whether there is --boost
void add_training_options(OptionSet& set, RunOptions& options, bool choose_boost);
/// Those of a command that trains options.backbone only, and on full-size views; add_run_options() adds those of all.
void add_boost_options(OptionSet& set, RunOptions& options);
void add_machine_options(OptionSet& set, RunOptions& options);
void add_lpips_option(OptionSet& set, RunOptions& options);
void add_config_option(OptionSet& set, RunOptions& options);
/// All options of the commands that train.
/// @param one_run true: a single run, boosted or not, which may resume from a checkpoint; false: compare, which runs
/// both and resumes in its folder
void add_run_options(OptionSet& set, RunOptions& options, const std::string& model_help, bool one_run);

/// Sets the options that the command line does not give from a settings object.
void apply_settings(const nlohmann::json& settings, const std::string& place, OptionSet& set, RunOptions& options);

/// Likewise, with a --config file between the two: it overrides the settings, and the command line overrides it.
void apply_settings_and_config(nlohmann::json settings, std::string place, OptionSet& set, RunOptions& options);

/// Throws on invalid values; the message names the option, or the settings file that gave it. If no number of
/// iterations is given, sets the published one of the backbone.
void check_options(const OptionSet& set, RunOptions& options);

/// Throws UsageError if the command line gives a setting of the acceleration to a run without it, or of a part of it
/// that is switched off.
void check_boost_options(const OptionSet& set, const RunOptions& options);

/// Checks everything about a run that can be checked before its data are read.
void check_run_options(const OptionSet& set, RunOptions& options);

}  // namespace splatboost::program

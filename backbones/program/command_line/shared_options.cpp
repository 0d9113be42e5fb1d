// SPDX-License-Identifier: Apache-2.0
#include "program/command_line/shared_options.h"

#include <algorithm>
#include <set>
#include <string_view>
#include <tuple>
#include <utility>

#include "program/session/chosen_device.h"
#include "program/session/plugged_backbone.h"
#include "splatboost/schedule.h"
#include "trainer/support/json_values.h"

namespace splatboost::program {
namespace {

using Json = nlohmann::json;

// Keys of a settings file that are not options: records of the run, and the constants.
const std::set<std::string>& reserved_keys() {
  static const std::set<std::string> keys = {"splatboost", "trained", "backbone", "boost", "slam"};
  return keys;
}

constexpr char kBoostGroup[] = "Acceleration";

std::string backbone_names() {
  std::string names;
  for (const BackboneEntry& entry : backbones()) names += (names.empty() ? "" : ", ") + std::string(entry.name);
  return names;
}

/// "30000; dropgaussian 10000": the usual length, then the backbones that differ.
std::string published_lengths() {
  std::string lengths = std::to_string(kPublishedIterations);
  for (const BackboneEntry& entry : backbones()) {
    if (entry.iterations == kPublishedIterations) continue;
    lengths += "; " + std::string(entry.name) + " " + std::to_string(entry.iterations);
  }
  return lengths;
}

std::string default_beta(std::string_view backbone) {
  return to_json(*find_adapter(backbone).make_settings(false))["beta"].dump();
}

/// "0.5; scaffold-gs 0.7": the paper's β, then the backbones that differ.
std::string default_betas() {
  const std::string paper = default_beta("vanilla");
  std::string betas = paper;
  for (const AdapterEntry& entry : adapters()) {
    const std::string beta = default_beta(entry.backbone);
    if (beta != paper) betas += "; " + std::string(entry.backbone) + " " + beta;
  }
  return betas;
}

/// @param betas the defaults of --beta, for its help
void add_rule_options(OptionSet& set, RunOptions& options, const std::string& betas) {
  set.set_group(kBoostGroup);
  set.add("--beta", options.beta, "compact box, in (0, 1]; smaller is faster but cuts faint edges [" + betas + "]",
          false)
      ->type_name("X");
  set.add("--tau-d", options.tau_d,
          "importance threshold for growth (docs/method.md); larger gives fewer primitives [5]", false)
      ->type_name("X");
  set.add("--views", options.views, "K: number of views that score the primitives [10]", false)->type_name("N");
  set.add("--literal", options.literal,
          "exactly the paper's rules and constants, without our additions (docs/method.md)", false);
  set.add("--no-vcd", options.no_vcd, "without multi-view consistent densification", false);
  set.add("--no-vcp", options.no_vcp, "without multi-view consistent pruning", false);
  set.add("--no-cb", options.no_cb, "without the compact box", false);
  set.add("--no-absgrad", options.no_absgrad, "without absolute gradients", false);
  set.add("--no-schedule", options.no_schedule, "without the optimizer schedule", false);
}

/// Assigns the values of `changes`, recursively where both are objects. Unlike Json::merge_patch(), keeps null as a
/// value, so that a null under an unknown key, or of an option that takes none, is reported like any other value.
void merge(Json& settings, const Json& changes) {
  for (const auto& [key, value] : changes.items()) {
    Json& place = settings[key];
    if (place.is_object() && value.is_object()) {
      merge(place, value);
    } else {
      place = value;
    }
  }
}

}  // namespace

void add_source_option(OptionSet& set, RunOptions& options) {
  set.set_group("Data");
  set.add("-s,--source", options.scene.source,
          "scene folder: COLMAP, Blender, nerfstudio, Nerfies or rig of videos; or packed scene")
      ->type_name("DIR");
}

void add_model_option(OptionSet& set, RunOptions& options, const std::string& help) {
  set.set_group("Data");
  set.add("-m,--model", options.model, help, false)->type_name("DIR");
}

void add_data_options(OptionSet& set, RunOptions& options) {
  SceneOptions& scene = options.scene;
  set.set_group("Data");
  set.add("-r,--resolution", scene.resolution, kResolutionHelp)->type_name("N");
  set.add("--eval", scene.eval, "hold out test views (every llffhold-th, or the dataset's own)");
  set.add("--llffhold", scene.llffhold, "use every N-th view as a test view")->type_name("N")->capture_default_str();
  set.add("--test-list", scene.test_list, "file that lists the test images, one per line")->type_name("FILE");
  set.add("--frame-times", scene.frame_times, kFrameTimesHelp);
  set.add("--frames", scene.frames, kFramesHelp)->type_name("N");
  set.add("--n-views", scene.n_views, "train on N evenly spread views; 0: all")->type_name("N")->capture_default_str();
  set.add("-i,--images", scene.images, kImagesHelp)->type_name("NAME");
  set.add("-w,--white-background", scene.white_background, "use a white instead of a black background");
}

void add_training_options(OptionSet& set, RunOptions& options, bool choose_boost) {
  set.set_group("Training");
  set.add("--backbone", options.backbone, "method to train: " + backbone_names(), false)
      ->type_name("NAME")
      ->capture_default_str();
  if (choose_boost)
    set.add("--boost,!--no-boost", options.boost, "train accelerated (default), or as published", false);
  set.add("--iterations", options.iterations,
          "number of iterations; schedules scale with it [" + published_lengths() + "]")
      ->type_name("N");
  set.add("--max-primitives", options.max_primitives, "hard cap on primitives; 0: none")
      ->type_name("N")
      ->capture_default_str();
  set.add("--seed", options.seed, "random seed; the same seed gives the same bytes")
      ->type_name("N")
      ->capture_default_str();
  set.add("--save-iterations", options.save_iterations, "also save the model at these iterations")
      ->type_name("N,N")
      ->delimiter(',');
  set.add("--checkpoint-iterations", options.checkpoint_iterations, "write a checkpoint at these iterations")
      ->type_name("N,N")
      ->delimiter(',');
}

void add_boost_options(OptionSet& set, RunOptions& options) {
  add_rule_options(set, options, default_beta(options.backbone));
}

void add_machine_options(OptionSet& set, RunOptions& options) {
  set.set_group("Machine");
  set.add("--device", options.device, "cpu, cuda, or cuda:N, the N-th GPU from 0")
      ->type_name("NAME")
      ->capture_default_str();
  set.add("--threads", options.threads, "number of threads; 0: all CPUs available to the process")
      ->type_name("N")
      ->capture_default_str();
}

void add_lpips_option(OptionSet& set, RunOptions& options) {
  set.set_group("Output");
  set.add("--lpips", options.lpips, "measure LPIPS with this SqueezeNet (made by scripts/lpips_to_onnx)")
      ->type_name("ONNX");
}

void add_config_option(OptionSet& set, RunOptions& options) {
  set.set_group("Output");
  set.add("--config", options.config, "read settings from a file, such as config.json of a run", false)
      ->type_name("FILE");
  set.add("--quiet", options.quiet, "no progress line", false);
}

void add_run_options(OptionSet& set, RunOptions& options, const std::string& model_help, bool one_run) {
  add_source_option(set, options);
  add_model_option(set, options, model_help);
  add_data_options(set, options);
  add_training_options(set, options, one_run);
  set.add("--resume", options.resume,
          one_run ? "resume from a checkpoint, with the settings of its run"
                  : "resume an interrupted comparison in its output folder, with its settings",
          false)
      ->type_name(one_run ? "CKPT" : "DIR");
  add_rule_options(set, options, default_betas());
  set.add("--no-coarse", options.no_coarse, "without the first phase on half-size views", false);
  add_machine_options(set, options);
  add_lpips_option(set, options);
  add_config_option(set, options);
}

void apply_settings(const Json& settings, const std::string& place, OptionSet& set, RunOptions& options) {
  require(!settings.contains("config"),
          place + ": config: a settings file cannot name another one; leave out this key");
  require(!settings.contains("resume"), place + ": resume: a settings file cannot name a run to resume; use --resume");
  set.overlay(settings, place, reserved_keys());
  if (settings.contains("backbone")) {
    Json constants = settings["backbone"];
    require(constants.is_object(), place + ": backbone must be a name or an object");
    if (constants.contains("name")) {
      std::string name;
      read_value(constants["name"], place + ": backbone: name", name);
      constants.erase("name");
      if (!set.given("backbone")) options.backbone = name;
      require(options.backbone == name || constants.empty(), place + ": its constants belong to backbone '" + name +
                                                                 "', but --backbone is '" + options.backbone + "'");
    }
    options.backbone_settings = std::move(constants);
  }
  if (settings.contains("boost")) {
    Json boost = settings["boost"];
    require(boost.is_object(), place + ": boost must be true, false or an object");
    if (boost.contains("enabled")) {
      bool enabled = true;
      read_value(boost["enabled"], place + ": boost: enabled", enabled);
      boost.erase("enabled");
      if (!set.given("boost")) options.boost = enabled;
    }
    // A whole set of constants, such as in the config.json of a run, would replace the paper's.
    require(
        !options.literal || boost.value("literal", Json(true)) != Json(false),
        place +
            ": boost has the constants of the default rules, which --literal would not change; leave out one of them");
    options.boost_settings = std::move(boost);
  }
}

void apply_settings_and_config(Json settings, std::string place, OptionSet& set, RunOptions& options) {
  if (!options.config.empty()) {
    merge(settings, read_settings_file(options.config));
    place = options.config.string();
  }
  apply_settings(settings, place, set, options);
}

void check_options(const OptionSet& set, RunOptions& options) {
  const auto positive = [](const std::vector<int>& iterations) {
    return std::ranges::all_of(iterations, [](int iteration) { return iteration >= 1; });
  };
  const char* const least = "must be at least 0";
  const char* const least_one = "must be at least 1";
  const int resolution = options.scene.resolution.value_or(-1);
  set.check(is_device_name(options.device), "device", kDeviceRule + (", not '" + options.device + "'"));
  set.check(is_thread_count(options.threads), "threads", threads_rule());
  set.check(!options.iterations || *options.iterations >= 1, "iterations", least_one);
  set.check(resolution == -1 || resolution >= 1, "resolution", "must be -1 or at least 1");
  set.check(options.scene.llffhold >= 1, "llffhold", least_one);
  set.check(options.scene.n_views >= 0, "n-views", least);
  set.check(options.scene.frames.value_or(0) >= 0, "frames", least);
  set.check(!options.beta || (*options.beta > 0 && *options.beta <= 1), "beta", "must be in (0, 1]");
  set.check(!options.tau_d || *options.tau_d >= 0, "tau-d", least);
  set.check(!options.views || *options.views >= 1, "views", least_one);
  set.check(positive(options.save_iterations), "save-iterations", least_one);
  set.check(positive(options.checkpoint_iterations), "checkpoint-iterations", least_one);
  set.check(options.iteration >= 0, "iteration", least);
  if (!options.iterations) options.iterations = find_backbone(options.backbone).iterations;
}

void check_boost_options(const OptionSet& set, const RunOptions& options) {
  const std::string name = options.boost ? "" : set.given_of(kBoostGroup);
  if (!name.empty()) {
    throw UsageError("--" + name + " has no effect without acceleration; leave it out, or train with --boost");
  }
  // Of the command line only: a settings file may hold the values of all settings.
  const std::tuple<const char*, bool, const char*> pairs[] = {
      {"beta", options.no_cb, "--no-cb"},
      {"tau-d", options.no_vcd, "--no-vcd"},
      {"views", options.no_vcd && options.no_vcp, "--no-vcd and --no-vcp"}};
  for (const auto& [option, off, switches] : pairs) {
    if (set.given(option) && off) {
      throw UsageError("--" + std::string(option) + " has no effect with " + switches + "; leave it out");
    }
  }
}

void check_run_options(const OptionSet& set, RunOptions& options) {
  require_source(options);
  require_model(options, "output");
  check_options(set, options);
  if (set.given("llffhold") && !options.scene.eval) {
    throw UsageError("--llffhold has no effect without --eval, which holds out test views");
  }
  const std::pair<const char*, const std::vector<int>&> lists[] = {
      {"save-iterations", options.save_iterations}, {"checkpoint-iterations", options.checkpoint_iterations}};
  for (const auto& [name, iterations] : lists) {
    // Those of a file may be of a longer run, whose settings are used again.
    if (!set.given(name)) continue;
    for (const int iteration : iterations) {
      if (iteration <= *options.iterations) continue;
      throw UsageError("--" + std::string(name) + ": " + std::to_string(iteration) + " is after the end of the run, " +
                       std::to_string(*options.iterations) + " iterations");
    }
  }
  boost_settings(options);  // throws on invalid settings
}

}  // namespace splatboost::program

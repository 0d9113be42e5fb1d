// SPDX-License-Identifier: Apache-2.0
/// @file The options that subcommands share, from the command line and from --config files.
#pragma once

#include <charconv>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <type_traits>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "splatboost/schedule.h"
#include "trainer/formats/read_scene.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

namespace splatboost::program {

/// An error in the command line. The message is followed by a reference to --help.
class UsageError : public InputError {
 public:
  using InputError::InputError;
};

template <class T>
struct OptionValue {
  using type = T;
};
template <class T>
struct OptionValue<std::optional<T>> : OptionValue<T> {};
template <class T>
struct OptionValue<std::vector<T>> : OptionValue<T> {};

/// Describes what is wrong with the text of an option; empty if nothing is. Without this check, the parser would take
/// an empty text (an unset shell variable) for an absent option, -1 and numbers out of range for the largest number,
/// and 010 for an octal number.
/// @tparam T type of a single value
template <class T>
std::string wrong_text(const std::string& text) {
  if (text.empty()) return "is empty; leave the option out, or give it a value";
  if constexpr (std::is_arithmetic_v<T>) {
    if (std::unsigned_integral<T> && text[0] == '-') return "must be at least 0";
    T value{};
    const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value);
    const bool whole = parsed.ptr == text.data() + text.size();
    if (parsed.ec == std::errc::result_out_of_range) return "'" + text + "' is out of range";
    bool good = parsed.ec == std::errc{} && whole;
    if constexpr (std::floating_point<T>) good = good && std::isfinite(value);
    if (!good) return "'" + text + "' is not a " + (std::floating_point<T> ? "number" : "whole number");
    if constexpr (std::integral<T>) {
      if (text != std::to_string(value)) return "'" + text + "' must not begin with 0";
    }
  }
  return {};
}

/// Adds an option whose text is checked by wrong_text() before it is parsed.
template <class T>
CLI::Option* add_checked_option(CLI::App& app, const std::string& names, T& value, const std::string& help) {
  return app.add_option(names, value, help)->check(CLI::Validator(wrong_text<typename OptionValue<T>::type>, ""));
}

/// Options that a JSON file can also set, by their long names. The command line overrides the file.
class OptionSet {
 public:
  /// Options join the app's help under the current group.
  explicit OptionSet(CLI::App& app) : app_(&app) {}

  void set_group(std::string group) { group_ = std::move(group); }
  /// Options added from here on can be set by files only: those of another subcommand whose files this one reads.
  void files_only() { app_ = &unseen_; }

  /// @param recorded whether config.json of a run holds it
  template <class T>
  CLI::Option* add(const std::string& names, T& value, const std::string& help, bool recorded = true) {
    CLI::Option* option = nullptr;
    if constexpr (std::same_as<T, bool>) {
      option = app_->add_flag(names, value, help);
    } else {
      option = add_checked_option(*app_, names, value, help);
    }
    option->group(group_);
    Entry entry;
    entry.option = option;
    entry.name = option->get_lnames().front();
    entry.recorded = recorded;
    entry.read = [&value](const nlohmann::json& json, const std::string& place, bool sets) {
      T read{};
      read_value(json, place, read);
      if (sets) value = std::move(read);
    };
    entry.write = [&value] { return to_record(value); };
    entries_.push_back(std::move(entry));
    return option;
  }

  /// Sets the options that the command line does not give from a file's JSON object. Keys in `reserved` are skipped;
  /// any other unknown key throws InputError, as does a value of the wrong type, also of an option that is given.
  void overlay(const nlohmann::json& object, const std::string& place, const std::set<std::string>& reserved);

  /// Values of the recorded options, without empty ones and with absolute paths. Throws InputError on a path that is
  /// not UTF-8, which JSON cannot hold.
  nlohmann::json record() const;

  bool given(const std::string& name) const;
  /// The first option of this group of the help that the command line gives; empty: none.
  std::string given_of(const std::string& group) const;

 private:
  struct Entry {
    CLI::Option* option = nullptr;
    std::string name;
    bool recorded = true;
    std::function<void(const nlohmann::json&, const std::string& place, bool sets)> read;
    std::function<nlohmann::json()> write;
  };

  template <class T>
  static nlohmann::json to_record(const T& value) {
    return value;
  }
  template <class T>
  static nlohmann::json to_record(const std::optional<T>& value) {
    return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
  }
  static nlohmann::json to_record(const std::filesystem::path& value);

  CLI::App* app_;
  CLI::App unseen_;
  std::string group_ = "Options";
  std::vector<Entry> entries_;
};

inline constexpr char kResolutionHelp[] =
    "1, 2, 4, 8: divisor; larger: width in px; -1: full, at most 1600 px wide [-1]";
inline constexpr char kIterationHelp[] = "model saved at this iteration; 0: the last";
inline constexpr char kImagesHelp[] = "image folder of a COLMAP scene [images], or of a Nerfies capture [rgb/1x]";
inline constexpr char kFrameTimesHelp[] = "COLMAP: the last number in an image name is the frame, which sets the time";
inline constexpr char kFramesHelp[] = "number of frames of each camera of a rig of videos; 0: all [24]";

/// The options of a run.
struct RunOptions {
  SceneOptions scene;
  std::filesystem::path model;
  std::string backbone = "vanilla";
  bool boost = true;
  std::optional<int> iterations;  ///< always set after check_options()
  std::uint64_t seed = 0;
  std::size_t max_primitives = 0;
  std::string device = "cpu";
  int threads = 0;
  std::optional<double> beta;
  std::optional<double> tau_d;
  std::optional<int> views;
  bool literal = false;
  bool no_vcd = false;
  bool no_vcp = false;
  bool no_cb = false;
  bool no_absgrad = false;
  bool no_schedule = false;
  bool no_coarse = false;
  std::filesystem::path lpips;
  bool lpips_if_possible = false;  ///< leave LPIPS out if its network or a view is not fit for it, instead of refusing
  std::filesystem::path config;
  std::vector<int> save_iterations;
  std::vector<int> checkpoint_iterations;
  std::filesystem::path resume;
  int iteration = 0;  ///< iteration of a saved model; 0: the last
  bool quiet = false;

  /// Constants of the backbone and of its acceleration, set by files.
  nlohmann::json backbone_settings = nlohmann::json::object();
  nlohmann::json boost_settings = nlohmann::json::object();
};

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

/// Reads a settings file as an object: {"backbone": {"name", constants…}, "boost": {"enabled", settings…}, options…}.
/// "backbone" may be just the name and "boost" just true or false; both are returned as objects.
nlohmann::json read_settings_file(const std::filesystem::path& path);

/// Sets the options that the command line does not give from a settings object.
void apply_settings(const nlohmann::json& settings, const std::string& place, OptionSet& set, RunOptions& options);

/// Likewise, with a --config file between the two: it overrides the settings, and the command line overrides it.
void apply_settings_and_config(nlohmann::json settings, std::string place, OptionSet& set, RunOptions& options);

/// Settings of the acceleration, from the files and overridden by the command line; complete and checked.
nlohmann::json boost_settings(const RunOptions& options);

/// Throws on invalid values, and on --device cuda for a backbone without CUDA support; the message names the option. If
/// no number of iterations is given, sets the published one of the backbone.
void check_options(RunOptions& options);

/// Throws UsageError if the command line gives a setting of the acceleration to a run without it, or of a part of it
/// that is switched off.
void check_boost_options(const OptionSet& set, const RunOptions& options);

/// Throws UsageError unless a source is given.
void require_source(const RunOptions& options);
/// Throws UsageError unless --model is given. @param kind of folder, for the message
void require_model(const RunOptions& options, const std::string& kind = "model");

/// Checks everything about a run that can be checked before its data are read.
void check_run_options(const OptionSet& set, RunOptions& options);

}  // namespace splatboost::program

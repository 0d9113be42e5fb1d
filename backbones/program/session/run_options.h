// SPDX-License-Identifier: Apache-2.0
/// @file The options of a run, and the settings files that hold them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "trainer/formats/read_scene.h"
#include "trainer/support/input_error.h"

namespace splatboost::program {

/// An error in the command line. The message is followed by a reference to --help.
class UsageError : public InputError {
 public:
  using InputError::InputError;
};

/// The options of a run.
struct RunOptions {
  SceneOptions scene;
  std::filesystem::path model;
  std::string backbone = "vanilla";
  bool boost = true;
  std::optional<int> iterations;  ///< always set after check_options() (command_line/shared_options.h)
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

/// Reads a settings file as an object: {"backbone": {"name", constants…}, "boost": {"enabled", settings…}, options…}.
/// "backbone" may be just the name and "boost" just true or false; both are returned as objects.
nlohmann::json read_settings_file(const std::filesystem::path& path);

/// Settings of the acceleration, from the files and overridden by the command line; complete and checked.
nlohmann::json boost_settings(const RunOptions& options);

/// Throws UsageError unless a source is given.
void require_source(const RunOptions& options);
/// Throws UsageError unless --model is given. @param kind of folder, for the message
void require_model(const RunOptions& options, const std::string& kind = "model");

}  // namespace splatboost::program

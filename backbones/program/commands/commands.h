// SPDX-License-Identifier: Apache-2.0
/// @file The subcommands. Each function adds one to the program and returns the function that runs it.
#pragma once

#include <functional>
#include <string>

#include <CLI/CLI.hpp>

namespace splatboost::program {

struct Command {
  CLI::App* app = nullptr;
  /// @param command_line as typed, for the record. @return exit code
  std::function<int(const std::string& command_line)> run;
};

Command add_train(CLI::App& program);
Command add_compare(CLI::App& program);
Command add_render(CLI::App& program);
Command add_eval(CLI::App& program);
Command add_mesh(CLI::App& program);
Command add_mesh_eval(CLI::App& program);
Command add_slam(CLI::App& program);
Command add_export(CLI::App& program);
Command add_synth(CLI::App& program);
Command add_pack(CLI::App& program);
Command add_points(CLI::App& program);
Command add_bench(CLI::App& program);
Command add_patch(CLI::App& program);

}  // namespace splatboost::program

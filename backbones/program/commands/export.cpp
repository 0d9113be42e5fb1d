// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "program/command_line/shared_options.h"
#include "program/commands/commands.h"
#include "program/session/model_folder.h"
#include "program/session/plugged_backbone.h"
#include "program/session/scene_files.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

struct ExportOptions {
  fs::path model, output;
  int iteration = 0;
};

int run_export(const ExportOptions& options) {
  if (options.model.empty()) throw UsageError("no model folder given: name it with -m/--model");
  if (options.output.empty())
    throw UsageError("no file to write given: name it with -o/--output, FILE.ply or FILE.glb");
  if (options.iteration < 0) throw UsageError("--iteration must be at least 0");
  const std::string ending = options.output.extension().string();
  if (ending != ".ply" && ending != ".glb") {
    throw UsageError(options.output.string() + ": the file name of a mesh must end in .ply or .glb");
  }
  const nlohmann::json config = read_config(options.model);
  const std::string place = (options.model / "config.json").string() + ": backbone: name";
  require(config.contains("backbone") && config["backbone"].contains("name"), place + " is missing");
  std::string name;
  read_value(config["backbone"]["name"], place, name);
  const BackboneEntry& entry = find_backbone(name);
  require(entry.export_mesh != nullptr, options.model.string() + ": a model of " + name +
                                            " cannot be exported as triangles; open its point_cloud.ply in a viewer");
  const fs::path saved = saved_model(options.model, options.iteration);
  require_replaceable(options.output, {saved / "point_cloud.ply"});
  require_no_scene_file(options.output, scenes_of(options.model, config), options.model);
  require_writable(options.output);
  remove_stale_files(fs::absolute(options.output).parent_path());
  entry.export_mesh(saved, options.output);
  std::printf("mesh: %s (%.1f MB)\n", options.output.c_str(), static_cast<double>(fs::file_size(options.output)) / 1e6);
  return 0;
}

}  // namespace

Command add_export(CLI::App& program) {
  CLI::App* app = program.add_subcommand("export", "Write the convexes of a model as triangles, for any viewer");
  app->footer("Example: splatboost export -m OUT -o convexes.glb");
  const auto options = std::make_shared<ExportOptions>();
  add_checked_option(*app, "-m,--model", options->model, "model folder of a run")->type_name("DIR");
  add_checked_option(*app, "--iteration", options->iteration, kIterationHelp)->type_name("N")->capture_default_str();
  add_checked_option(*app, "-o,--output", options->output, "file to write")->type_name("FILE.ply|FILE.glb");
  return {app, [options](const std::string&) { return run_export(*options); }};
}

}  // namespace splatboost::program

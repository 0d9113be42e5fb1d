// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "program/command_line/shared_options.h"
#include "program/commands/commands.h"
#include "program/session/model_folder.h"
#include "program/session/run.h"
#include "trainer/support/text.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

struct Train {
  explicit Train(CLI::App& app) : set(app) { add_run_options(set, options, "output folder", true); }

  /// MODEL/checkpoints/iteration_N.ckpt → MODEL
  fs::path folder_of_checkpoint() const { return fs::absolute(options.resume).parent_path().parent_path(); }

  /// Later ones override earlier ones: settings of the run of the checkpoint, then --config, then the command line.
  void read_settings() {
    nlohmann::json settings = nlohmann::json::object();
    std::string place;
    if (!options.resume.empty()) {
      require(!fs::is_directory(options.resume),
              options.resume.string() +
                  ": is a folder; name a checkpoint, MODEL/checkpoints/iteration_N.ckpt, or resume a comparison with "
                  "splatboost compare --resume");
      require(is_file(options.resume), options.resume.string() + ": no such checkpoint");
      require(options.resume.extension() == ".ckpt",
              options.resume.string() + ": is not a checkpoint; name one, MODEL/checkpoints/iteration_N.ckpt");
      const fs::path config = folder_of_checkpoint() / "config.json";
      if (is_file(config)) {
        settings = read_settings_file(config);
        place = config.string();
        if (options.model.empty()) options.model = folder_of_checkpoint();
      }
    }
    apply_settings_and_config(std::move(settings), place, set, options);
  }

  int run(const std::string& command_line) {
    read_settings();
    check_run_options(set, options);
    check_boost_options(set, options);
    std::error_code ignored;
    const bool goes_on_in_place =
        !options.resume.empty() && fs::equivalent(options.model, folder_of_checkpoint(), ignored);
    require_ours_or_empty(options.model);
    if (!goes_on_in_place) require_only_results(options.model);
    require_no_comparison(options.model);
    require_inputs_elsewhere(options.model, options);
    Workbench bench = make_workbench(options);
    std::optional<FolderLock> lock;
    const auto take_folder = [&](const std::string& config) {
      lock = take_model_folder(options.model, goes_on_in_place ? config : std::string());
    };
    const RunOutcome outcome =
        run_once(bench, set.record(), options, options.boost, options.model, command_line, take_folder);
    if (outcome.interrupted_by != 0 && outcome.checkpoint.empty()) {
      return end_interrupted(outcome, "splatboost eval -m " + shell_word(options.model.string()));
    }
    if (outcome.interrupted_by != 0) {
      return end_interrupted(outcome, "splatboost train --resume " + shell_word(outcome.checkpoint.string()));
    }
    std::printf("%s\nreport: %s\n", results_table(outcome.run.results).c_str(),
                (options.model / "report.html").c_str());
    return 0;
  }

  RunOptions options;
  OptionSet set;
};

}  // namespace

Command add_train(CLI::App& program) {
  CLI::App* app = program.add_subcommand("train", "Train a scene and measure the result");
  app->footer("Example: splatboost train -s SCENE -m OUT --eval --iterations 7000");
  const auto train = std::make_shared<Train>(*app);
  return {app, [train](const std::string& command_line) { return train->run(command_line); }};
}

}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "program/command_line/shared_options.h"
#include "program/commands/commands.h"
#include "program/session/model_folder.h"
#include "program/session/run.h"
#include "trainer/evaluation/result_tables.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/text.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

struct Compare {
  explicit Compare(CLI::App& app) : set(app) {
    add_run_options(set, options, "output folder; baseline/ and boosted/ are created in it", false);
  }

  /// Later ones override earlier ones: settings of the resumed comparison, then --config, then the command line.
  void read_settings() {
    nlohmann::json settings = nlohmann::json::object();
    std::string place;
    if (resumes()) {
      settings = read_config(options.resume);
      require_comparison(options.resume);
      place = (options.resume / "config.json").string();
      if (options.model.empty()) options.model = options.resume;
    }
    apply_settings_and_config(std::move(settings), place, set, options);
  }

  bool resumes() const { return !options.resume.empty(); }

  fs::path folder_of(bool boost) const { return options.model / run_label(boost); }

  /// Trains and measures a run. Of a resumed comparison, a finished run is only measured again, which gives what the
  /// report shows of it, and an interrupted one goes on from its latest checkpoint.
  RunOutcome run_one(Workbench& bench, bool boost, const std::string& command_line,
                     const std::function<void()>& take_folders) {
    const fs::path folder = folder_of(boost);
    RunOptions of_run = options;
    of_run.resume.clear();
    if (resumes()) {
      if (std::optional<Results> trained = trained_results(folder)) {
        require(is_machine_of(*trained, *bench.device), folder.string() + ": its times are those of " +
                                                            trained->device + ", " + std::to_string(trained->threads) +
                                                            " threads, " + trained->machine +
                                                            "; resume there, so that they can be compared");
        take_folders();
        return measure_saved_run(bench, options, folder, std::move(*trained));
      }
      if (fs::is_directory(folder / "checkpoints")) of_run.resume = folder / "checkpoints";
    }
    return run_once(bench, set.record(), of_run, boost, folder, command_line,
                    [&](const std::string&) { take_folders(); });
  }

  int run(const std::string& command_line) {
    read_settings();
    check_run_options(set, options);
    check_boost_options(set, options);
    std::error_code ignored;
    if (resumes() && !fs::equivalent(options.model, options.resume, ignored)) {
      throw UsageError("--resume continues in " + options.resume.string() + "; leave out --model");
    }
    require_no_run_of_comparison(options.model);
    for (const fs::path& folder : {options.model, folder_of(false), folder_of(true)}) {
      require_ours_or_empty(folder);
      if (!resumes()) require_only_results(folder);
      require_inputs_elsewhere(folder, options);
    }
    Workbench bench = make_workbench(options);
    const std::string config = config_text(set.record(), options, true, nullptr);
    // Reports errors of the second run before the first one starts.
    const std::string configs[] = {config_of_run(bench, set.record(), options, false),
                                   config_of_run(bench, set.record(), options, true)};
    for (const bool boost : {false, true}) {
      if (resumes()) require_same_run(folder_of(boost), configs[boost ? 1 : 0]);
    }

    std::vector<FolderLock> locks;
    // All folders at once: a run of an earlier comparison must not pass for the second one of this.
    const auto take_folders = [&] {
      if (!locks.empty()) return;
      const std::pair<fs::path, std::string> folders[] = {
          {options.model, config}, {folder_of(false), configs[0]}, {folder_of(true), configs[1]}};
      for (const auto& [folder, text] : folders) {
        locks.push_back(take_model_folder(folder, resumes() ? text : std::string()));
        write_config(folder, text);
      }
    };
    std::vector<ReportRun> runs;
    std::vector<ReportView> views;
    for (const bool boost : {false, true}) {
      RunOutcome outcome = run_one(bench, boost, command_line, take_folders);
      if (outcome.interrupted_by != 0) {
        return end_interrupted(outcome, "splatboost compare --resume " + shell_word(options.model.string()));
      }
      views = std::move(outcome.views);
      runs.push_back(std::move(outcome.run));
    }
    const Results& baseline = runs[0].results;
    const Results& boosted = runs[1].results;
    write_text_atomically(options.model / "compare.json", comparison_to_json(baseline, boosted).dump(2) + "\n");
    const fs::path report = options.model / "report.html";
    write_report(report, baseline.source + " — " + options.backbone + ", baseline and boosted", runs, views);
    const std::string labels[] = {runs[0].label, runs[1].label};
    const Results both[] = {baseline, boosted};
    std::printf("%s\n%s\nreport: %s\n", comparison_table(baseline, boosted).c_str(), scales_table(labels, both).c_str(),
                report.c_str());
    return 0;
  }

  RunOptions options;
  OptionSet set;
};

}  // namespace

Command add_compare(CLI::App& program) {
  CLI::App* app =
      program.add_subcommand("compare", "Train as published and accelerated, same seed and data, side by side");
  app->footer("Example: splatboost compare -s SCENE -m OUT --eval --iterations 2000");
  const auto compare = std::make_shared<Compare>(*app);
  return {app, [compare](const std::string& command_line) { return compare->run(command_line); }};
}

}  // namespace splatboost::program

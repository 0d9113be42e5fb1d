// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <memory>

#include "program/commands/commands.h"
#include "program/session/model_folder.h"
#include "program/session/run.h"
#include "trainer/evaluation/result_tables.h"
#include "trainer/support/atomic_file.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

struct Compare {
  explicit Compare(CLI::App& app) : set(app) {
    add_run_options(set, options, "output folder; baseline/ and boosted/ are created in it", false);
  }

  int run(const std::string& command_line) {
    if (!options.config.empty()) {
      apply_settings(read_settings_file(options.config), options.config.string(), set, options);
    }
    check_run_options(options);
    const auto folder_of = [&](bool boost) { return options.model / run_label(boost); };
    for (const fs::path& folder : {options.model, folder_of(false), folder_of(true)}) {
      require_ours_or_empty(folder);
      require_inputs_elsewhere(folder, options.scene);
    }
    Workbench bench = make_workbench(options);
    const std::string config = config_text(set, options, true, nullptr);
    check_backbone(bench, options, true);  // reports errors of the second run before the first one starts

    std::vector<FolderLock> locks;
    std::vector<ReportRun> runs;
    std::vector<ReportView> views;
    for (const bool boost : {false, true}) {
      const auto take_folder = [&](const std::string&) {
        if (!boost) {
          locks.push_back(take_model_folder(options.model));
          write_config(options.model, config);
        }
        locks.push_back(take_model_folder(folder_of(boost)));
      };
      RunOutcome outcome = run_once(bench, set, options, boost, folder_of(boost), command_line, take_folder);
      if (outcome.interrupted_by != 0) return exit_code_of_signal(outcome.interrupted_by);
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

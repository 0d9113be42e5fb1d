// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <limits>
#include <memory>
#include <optional>

#include "program/command_line/saved_model_options.h"
#include "program/commands/commands.h"
#include "program/session/model_folder.h"
#include "program/session/saved_model.h"
#include "program/slam/slam_results.h"
#include "trainer/evaluation/evaluate.h"
#include "trainer/evaluation/result_tables.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/text.h"
#include "trainer/training/trainer.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

std::string fixed(double value, int digits) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

struct Eval {
  explicit Eval(CLI::App& app) : set(app) {
    add_saved_model_options(set, options);
    add_measuring_options(set, options);
  }

  int run() {
    const SavedModel saved = find_saved_model(set, options);
    const fs::path results_path = options.model / "results.json";
    const fs::path training_path = options.model / kTrainingFile;
    const bool measured = fs::exists(results_path);
    const nlohmann::json config = read_config(options.model);
    const std::string did_not_end = results_path.string() + ": missing: the run did not finish; " +
                                    (config.contains("slam") ? "run splatboost slam again, which has no checkpoints"
                                                             : "finish it with splatboost train --resume");
    require(measured || fs::exists(training_path), did_not_end);
    const nlohmann::json before = read_json_file(measured ? results_path : training_path);
    Results results = read_results(measured ? results_path : training_path);
    // A model saved before the end is measured and printed, but results.json describes the end of the run.
    const bool of_the_end = saved_iteration(saved.folder) == results.iterations;
    require(measured || of_the_end || options.iteration == 0, did_not_end);
    require(measured || of_the_end, results_path.string() +
                                        ": missing: the run was interrupted during the evaluation; evaluate "
                                        "the final model first, without --iteration");

    options.lpips_if_possible = !set.given("lpips");  // what the run asked for may not suit its views
    OpenModel model(saved, options);
    Backbone& backbone = model.backbone();
    Lpips* const lpips = model.bench().lpips.get();
    // The scene of the run may have moved, or its folder hold other data now. Another scene is measured and printed,
    // but results.json is that of the run.
    const bool of_the_run = is_scene_of_run(config, options.scene.source, model.scene());
    require(measured || of_the_run,
            results_path.string() + ": missing: the run was interrupted during the evaluation, and " +
                options.scene.source.string() + " is not its scene; evaluate its own scene first, " +
                (set.given("source") ? "without --source" : "named by --source"));
    // Only slam measures all tracked frames. A run of slam that was stopped before it measured has nothing to keep.
    const bool of_slam = before.contains("slam");
    const bool of_tracked = of_slam && results.split != "train" && !results.views.empty();
    const bool writes = of_the_end && of_the_run && !of_tracked;
    std::optional<FolderLock> lock;
    if (writes) {
      lock.emplace(options.model);
      remove_stale_files(options.model);
    }
    const Results earlier = results;
    std::vector<ReportView> keyframes;
    if (of_slam && writes) {
      keyframes = measure_keyframes(backbone, model.scene(), lpips, options.model, results);
    } else if (measured) {
      evaluate(backbone, model.scene(), lpips, {}, results);
    } else {
      // The run was killed after its last iteration: complete its output now.
      results.storage_bytes = model_bytes(saved.folder);
      results = measure_run(model.bench(), backbone, options.model, std::move(results)).run.results;
    }
    Results exact;
    backbone.rasterizer_hook().set_beta(1.0f);
    evaluate(backbone, model.scene(), lpips, {}, exact);

    // Times in the results stay those of the machine that trained.
    const bool keeps_fps = writes && !is_machine_of(earlier, *model.bench().device);
    if (writes && (measured || keeps_fps)) {
      Results kept = results;
      if (keeps_fps) kept.fps = measured ? earlier.fps : std::numeric_limits<double>::quiet_NaN();
      if (!lpips) keep_lpips(earlier, kept);
      nlohmann::json json = to_json(kept);
      if (of_slam) {
        json["slam"] = before.at("slam");  // the tracking is not measured again
        write_slam_report(options.model, run_label(kept.boost), kept, json, keyframes);
      }
      write_text_atomically(results_path, json.dump(2) + "\n");
    }
    print(results, exact, saved.beta);
    if (writes) std::printf("\nresults: %s\n", results_path.c_str());
    if (keeps_fps && !options.quiet) {
      const std::string machine = earlier.machine.empty() ? "" : ", " + earlier.machine;
      std::fprintf(stderr, "note: %s: these frames per second were not written: times there are for %s, %d threads%s\n",
                   results_path.c_str(), printable(earlier.device).c_str(), earlier.threads,
                   printable(machine).c_str());
    }
    if (!of_the_run) {
      std::printf("\n%s is another scene than that of the run: %s was not changed\n", options.scene.source.c_str(),
                  results_path.c_str());
    } else if (of_tracked && of_the_end) {
      std::printf(
          "\nthese are the keyframes alone: %s was not changed, because it is for all tracked frames, which only a new "
          "run of slam can measure\n",
          results_path.c_str());
    }
    return 0;
  }

 private:
  /// LPIPS is not measured again without its network. It still holds for the same model and views.
  static void keep_lpips(const Results& earlier, Results& results) {
    if (!std::ranges::equal(earlier.views, results.views, {}, &ViewResult::name, &ViewResult::name)) return;
    results.lpips = earlier.lpips;
    for (std::size_t i = 0; i < results.views.size(); ++i) results.views[i].lpips = earlier.views[i].lpips;
  }

  static void print(const Results& results, const Results& exact, std::optional<float> beta) {
    const std::string box = beta ? "as trained (beta " + readable(*beta).dump() + ")" : "as trained (own box)";
    const auto line = [](const std::string& label, const std::string& trained, const std::string& one) {
      std::printf("%-26s %12s %12s\n", label.c_str(), trained.c_str(), one.c_str());
    };
    std::printf("%zu %s views; first column %s, second with beta 1, without the compact box\n\n", results.views.size(),
                results.split.c_str(), box.c_str());
    line("", "as trained", "beta 1");
    line("PSNR, dB", fixed(results.psnr, 2), fixed(exact.psnr, 2));
    line("SSIM", fixed(results.ssim, 4), fixed(exact.ssim, 4));
    if (results.lpips && exact.lpips) line("LPIPS (SqueezeNet)", fixed(*results.lpips, 4), fixed(*exact.lpips, 4));
    line("frames per second", fixed(results.fps, 1), fixed(exact.fps, 1));
    const std::string labels[] = {"as trained", "beta 1"};
    const Results both[] = {results, exact};
    std::printf("\n%s", scales_table(labels, both).c_str());
  }

  RunOptions options;
  OptionSet set;
};

}  // namespace

Command add_eval(CLI::App& program) {
  CLI::App* app =
      program.add_subcommand("eval", "Measure a saved model again, as trained and with beta = 1, at several scales");
  app->footer(
      "Updates OUT/results.json. For another scene, an earlier model (--iteration) or a run of slam that measured\n"
      "frames it only prints.\n"
      "Example: splatboost eval -m OUT");
  const auto eval = std::make_shared<Eval>(*app);
  return {app, [eval](const std::string&) { return eval->run(); }};
}

}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <map>
#include <memory>

#include "program/bench/bench_figures.h"
#include "program/bench/bench_tables.h"
#include "program/bench/blend_work.h"
#include "program/bench/convex_bench.h"
#include "program/bench/cuda_figures.h"
#include "program/bench/machine_limits.h"
#include "program/command_line/option_set.h"
#include "program/commands/commands.h"
#include "program/session/chosen_device.h"
#include "program/session/run.h"
#include "program/session/run_options.h"
#include "splatboost/instruction_set.h"
#include "splatboost/multi_view_scores.h"
#include "trainer/evaluation/results.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/process_info.h"
#include "trainer/support/temporary_folder.h"
#include "trainer/synth/bench_scene.h"
#include "vanilla/vanilla.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

// Far from every event of the published run (densification, opacity reset), with all degrees of spherical harmonics
// active.
constexpr int kFirstIteration = 10001;
constexpr int kMaxRepeats = 95;

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return 1e3 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// The published constants with learning rates of nearly zero, so that every repeat sees the same scene.
VanillaConfig still_config() {
  VanillaConfig config;
  config.position_rate_initial = config.position_rate_final = 1e-20;
  config.feature_rate = config.opacity_rate = config.scaling_rate = config.rotation_rate = 1e-20;
  return config;
}

std::unique_ptr<Backbone> make_backbone(const BenchScene& bench, const Threads& threads) {
  auto backbone = make_vanilla({bench.scene, threads}, still_config());
  const TemporaryFolder folder;
  write_splat_ply(folder / "point_cloud.ply", bench.cloud);
  backbone->import_model(folder.path());
  backbone->rasterizer_hook().set_beta(1.0f);
  return backbone;
}

/// Milliseconds of every stage of a training iteration, and of the whole.
BenchSamples measure_iterations(Backbone& backbone, const View& view, int repeats) {
  BenchSamples samples;
  for (int i = 0; i < kBenchWarmUp + repeats; ++i) {
    const auto before = backbone.stages().seconds();
    const auto start = std::chrono::steady_clock::now();
    backbone.train_step(kFirstIteration + i, view);
    const double iteration = milliseconds_since(start);
    if (i < kBenchWarmUp) continue;
    for (const auto& [stage, seconds] : backbone.stages().seconds()) {
      const auto at = before.find(stage);
      samples[stage].push_back(1e3 * (seconds - (at == before.end() ? 0 : at->second)));
    }
    samples["iteration"].push_back(iteration);
  }
  return samples;
}

BenchSamples measure_stages(Backbone& backbone, const View& view, const Threads& threads, int repeats) {
  BenchSamples samples = measure_iterations(backbone, view, repeats);
  MultiViewScorer scorer(threads);
  for (int i = 0; i < kBenchWarmUp + repeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    scorer.score(backbone.rasterizer_hook(), {.views = 1}, RandomStream(0, 0, RandomPurpose::scored_views));
    if (i >= kBenchWarmUp) samples["scoring"].push_back(milliseconds_since(start));
  }
  return samples;
}

Json scene_with_work(const BenchSize& size, const BlendWork& work, const Json& milliseconds, const Effort& forward,
                     const Effort& backward, const MachineLimits& limits) {
  Json scene = scene_json(size, work, milliseconds);
  scene["blend_work"] = {{"entries", work.entries},
                         {"rows", work.cells},
                         {"pairs", work.pairs},
                         {"forward", effort_json(forward, milliseconds["blend"].get<double>(), limits)},
                         {"backward", effort_json(backward, milliseconds["blend_backward"].get<double>(), limits)}};
  return scene;
}

Json measure(const BenchSize& size, const Threads& threads, int repeats, const MachineLimits& limits) {
  const BenchScene bench = make_bench_scene(size);
  const auto backbone = make_backbone(bench, threads);
  const Json milliseconds = medians_json(measure_stages(*backbone, bench.scene.train[0], threads, repeats));
  const BlendWork work = count_blend_work(bench, kTileRow, threads);
  return scene_with_work(size, work, milliseconds, blend_effort(work), blend_backward_effort(work), limits);
}

Json measure_convexes(const Threads& threads, int repeats, const MachineLimits& limits) {
  const BenchSize& size = convex_bench_size();
  const ConvexBench bench = make_convex_bench(size);
  const auto backbone = make_still_convexes(bench, threads);
  const Json milliseconds = medians_json(measure_stages(*backbone, bench.splats.scene.train[0], threads, repeats));
  const BlendWork work = count_blend_work(bench, kTileRow, threads);
  return scene_with_work(size, work, milliseconds, blend_convexes_effort(work), blend_convexes_backward_effort(work),
                         limits);
}

/// Times of an iteration for scenes that differ in one size.
Json measure_series(const std::vector<BenchSize>& sizes, const Threads& threads, int repeats) {
  Json series = Json::array();
  for (const BenchSize& size : sizes) {
    const BenchScene bench = make_bench_scene(size);
    const auto backbone = make_backbone(bench, threads);
    series.push_back({{"splats", size.splats},
                      {"width", size.width},
                      {"height", size.height},
                      {"threads", threads.count()},
                      {"milliseconds", medians_json(measure_iterations(*backbone, bench.scene.train[0], repeats))}});
  }
  return series;
}

/// The 60k scene with more or fewer splats, with more or fewer pixels of the same picture, and on fewer threads.
Json measure_scaling(const Threads& threads, int repeats) {
  const BenchSize middle = bench_sizes()[1];
  std::vector<BenchSize> splats, pixels;
  for (const std::size_t n : {10000, 20000, 40000, 80000, 160000}) {
    splats.push_back({"", n, middle.width, middle.height, middle.deviation});
  }
  for (const int width : {320, 480, 640, 960, 1280}) {
    const double factor = static_cast<double>(width) / middle.width;
    pixels.push_back({"", middle.splats, width, static_cast<int>(middle.height * factor), middle.deviation * factor});
  }
  Json of_threads = Json::array();
  for (int count = 1; count < threads.count(); count *= 2) {
    Threads fewer(count);
    of_threads.push_back(measure_series({middle}, fewer, repeats)[0]);
  }
  of_threads.push_back(measure_series({middle}, threads, repeats)[0]);
  return {{"splats", measure_series(splats, threads, repeats)},
          {"pixels", measure_series(pixels, threads, repeats)},
          {"threads", of_threads}};
}

/// Reads an earlier output file to compare with. Throws InputError if it is none.
Json read_earlier(const fs::path& path) {
  Json earlier = read_json_file(path);
  const auto is_scene = [](const Json& scene) {
    if (!scene.is_object()) return false;
    const Json times = scene.value("milliseconds", Json::object());
    return times.is_object() && std::all_of(times.begin(), times.end(), [](const Json& t) { return t.is_number(); });
  };
  const Json scenes = earlier.value("scenes", Json());
  require(scenes.is_array() && std::all_of(scenes.begin(), scenes.end(), is_scene),
          path.string() + ": not an output file of splatboost bench");
  return earlier;
}

struct Bench {
  fs::path output;
  fs::path compare;
  std::vector<std::string> scenes;
  std::string device = "cpu";
  std::string instruction_set = "best";
  int threads = 0;
  int repeats = 20;
  bool scaling = false;

  explicit Bench(CLI::App& app) {
    add_checked_option(app, "-o,--output", output, "write the figures as JSON")->type_name("FILE");
    add_checked_option(app, "--compare", compare, "JSON file of an earlier run; also prints the ratios of the times")
        ->type_name("FILE");
    add_checked_option(app, "--scenes", scenes, "scenes to time, of 20k, 60k, 200k and convexes [20k,60k,200k]")
        ->delimiter(',')
        ->type_name("NAME,NAME");
    add_checked_option(app, "--repeats", repeats, "number of iterations; the median is reported")
        ->type_name("N")
        ->capture_default_str();
    app.add_flag("--scaling", scaling, "also time an iteration for varying numbers of splats, pixels and threads");
    add_checked_option(app, "--device", device, "cpu, cuda, or cuda:N, the N-th GPU from 0")
        ->type_name("NAME")
        ->capture_default_str();
    add_checked_option(app, "--threads", threads, "number of threads; 0: all CPUs available to the process")
        ->type_name("N")
        ->capture_default_str();
    add_checked_option(app, "--instruction-set", instruction_set, "best, avx512, avx2 or portable")
        ->type_name("NAME")
        ->capture_default_str();
  }

  int run(const std::string& command_line) const {
    if (repeats < 1 || repeats > kMaxRepeats) {
      throw UsageError("--repeats must be 1 to " + std::to_string(kMaxRepeats));
    }
    if (!output.empty() && output.extension() != ".json") throw UsageError("--output must end in .json");
    check_threads(threads);
    check_device_name(device);
    if (scaling && device != "cpu") throw UsageError("--scaling is only available on the CPU: leave out --device");
    std::vector<BenchSize> chosen;
    for (const BenchSize& size : bench_sizes()) {
      if (scenes.empty() || std::find(scenes.begin(), scenes.end(), size.name) != scenes.end()) chosen.push_back(size);
    }
    for (const std::string& name : scenes) {
      const auto known = [&](const BenchSize& size) { return size.name == name; };
      if (name != convex_bench_size().name && std::none_of(chosen.begin(), chosen.end(), known)) {
        throw UsageError("--scenes: unknown scene '" + name + "'; available: 20k, 60k, 200k, convexes");
      }
    }
    const bool with_convexes = std::ranges::find(scenes, convex_bench_size().name) != scenes.end();
    if (with_convexes && device != "cpu")
      throw UsageError("--scenes convexes is only available on the CPU: leave out --device");
    hold_instruction_set();
    Json old;
    if (!compare.empty()) old = read_earlier(compare);
    if (!output.empty()) {
      require_replaceable(output, {compare});
      require_earlier_output(output, {"scenes", "machine", "repeats"}, "splatboost bench");
      require_writable(output);
    }

    ChosenDevice where(device, threads);
    Json document = {{"machine", machine_name()},     {"device", where.name()},  {"date", utc_now()},
                     {"version", SPLATBOOST_VERSION}, {"command", command_line}, {"repeats", repeats},
                     {"scenes", Json::array()}};
    const bool on_cuda = where.device().is_cuda();
    if (on_cuda) {
      document["commit"] = *SPLATBOOST_COMMIT != '\0' ? Json(SPLATBOOST_COMMIT) : Json();
      add_cuda_figures(chosen, repeats, where.device().stream(), where.threads(), document);
    } else {
      measure_on_cpu(chosen, with_convexes, where.threads(), document);
    }
    if (!output.empty()) write_text_atomically(output, document.dump(1) + "\n");
    print_times(document, compare.empty() ? nullptr : &old);
    if (on_cuda) {
      print_efforts(document);
    } else {
      print_blend_work(document);
    }
    if (scaling) print_scaling(document["scaling"]);
    return 0;
  }

 private:
  void measure_on_cpu(const std::vector<BenchSize>& sizes, bool with_convexes, const Threads& pool,
                      Json& document) const {
    document["threads"] = pool.count();
    document["instruction_set"] = instruction_set_name();
    const MachineLimits limits = measure_limits(pool);
    document["limits"] = limits_json(limits);
    for (const BenchSize& size : sizes) document["scenes"].push_back(measure(size, pool, repeats, limits));
    if (with_convexes) document["scenes"].push_back(measure_convexes(pool, repeats, limits));
    if (scaling) document["scaling"] = measure_scaling(pool, repeats);
  }

  void hold_instruction_set() const {
    const std::pair<const char*, InstructionSet> names[] = {{"best", InstructionSet::best},
                                                            {"avx512", InstructionSet::avx512},
                                                            {"avx2", InstructionSet::avx2},
                                                            {"portable", InstructionSet::portable}};
    for (const auto& [name, set] : names) {
      if (instruction_set == name) {
        use_instruction_set(set);
        return;
      }
    }
    throw UsageError("--instruction-set: '" + instruction_set + "' is not one of best, avx512, avx2, portable");
  }
};

}  // namespace

Command add_bench(CLI::App& program) {
  CLI::App* app = program.add_subcommand("bench", "Time the stages of a training iteration on fixed scenes");
  app->footer("Example: splatboost bench -o new.json --compare old.json");
  const auto bench = std::make_shared<Bench>(*app);
  return {app, [bench](const std::string& command_line) { return bench->run(command_line); }};
}

}  // namespace splatboost::program

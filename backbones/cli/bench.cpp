// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>

#include "cli/blend_work.h"
#include "cli/commands.h"
#include "cli/machine_limits.h"
#include "cli/options.h"
#include "cli/run.h"
#include "common/atomic_file.h"
#include "common/bench_scene.h"
#include "common/results.h"
#include "splatboost/instruction_set.h"
#include "splatboost/multi_view_scores.h"
#include "vanilla/vanilla.h"

namespace splatboost::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

/// Stages in the order of an iteration, and what they are called in the table. "iteration" is all before it and what
/// lies between them; "scoring" is one scored view: render, error map, loss, count replay.
constexpr std::pair<const char*, const char*> kStages[] = {
    {"activate", "activate"},
    {"project", "project"},
    {"tile_lists", "sort and bin"},
    {"blend", "blend forward"},
    {"loss", "L1 + SSIM and gradient"},
    {"blend_backward", "blend backward"},
    {"project_backward", "project backward"},
    {"statistics", "statistics"},
    {"optimizer", "Adam, all parameters"},
    {"iteration", "iteration"},
    {"scoring", "scoring a view"},
};

constexpr int kWarmUp = 3;
// Far from every event of the published run (growth, reset), with all degrees of spherical harmonics active.
constexpr int kFirstIteration = 10001;
constexpr int kMostRepeats = 95;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 == 1 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
}

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return 1e3 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// A folder of our own that goes away with this object.
struct TemporaryFolder {
  fs::path path = fs::temp_directory_path() / ("splatboost-bench-" + std::to_string(::getpid()));
  TemporaryFolder() { fs::create_directories(path); }
  ~TemporaryFolder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
};

/// The published constants with rates of nearly zero: every repeat then sees the same scene.
VanillaConfig still_config() {
  VanillaConfig config;
  config.position_rate_initial = config.position_rate_final = 1e-20;
  config.feature_rate = config.opacity_rate = config.scaling_rate = config.rotation_rate = 1e-20;
  return config;
}

using Samples = std::map<std::string, std::vector<double>>;

std::unique_ptr<Backbone> make_backbone(const BenchScene& bench, Threads& threads) {
  auto backbone = make_vanilla({bench.scene, threads}, still_config());
  const TemporaryFolder folder;
  write_splat_ply(folder.path / "point_cloud.ply", bench.cloud);
  backbone->import_model(folder.path);
  backbone->rasterizer_hook().set_beta(1.0f);
  return backbone;
}

/// Milliseconds of every stage of a training iteration, and of the whole.
Samples measure_iterations(Backbone& backbone, const View& view, int repeats) {
  Samples samples;
  for (int i = 0; i < kWarmUp + repeats; ++i) {
    const auto before = backbone.stages().seconds();
    const auto start = std::chrono::steady_clock::now();
    backbone.train_step(kFirstIteration + i, view);
    const double iteration = milliseconds_since(start);
    if (i < kWarmUp) continue;
    for (const auto& [stage, seconds] : backbone.stages().seconds()) {
      const auto at = before.find(stage);
      samples[stage].push_back(1e3 * (seconds - (at == before.end() ? 0 : at->second)));
    }
    samples["iteration"].push_back(iteration);
  }
  return samples;
}

/// Medians of the stages that were measured.
Json medians(const Samples& samples) {
  Json milliseconds = Json::object();
  for (const auto& [stage, title] : kStages) {
    const auto found = samples.find(stage);
    if (found != samples.end()) milliseconds[stage] = median(found->second);
  }
  return milliseconds;
}

Json effort_json(const Effort& effort, double milliseconds, const MachineLimits& limits) {
  const double seconds = 1e-3 * milliseconds;
  return {{"operations", effort.operations},
          {"bytes", effort.bytes},
          {"share_of_operations", effort.operations / seconds / limits.operations_per_second},
          {"share_of_bytes", effort.bytes / seconds / limits.bytes_per_second}};
}

Json measure(const BenchSize& size, Threads& threads, int repeats, const MachineLimits& limits) {
  const BenchScene bench = make_bench_scene(size);
  const auto backbone = make_backbone(bench, threads);
  RasterizerHook& rasterizer = backbone->rasterizer_hook();
  Samples samples = measure_iterations(*backbone, bench.scene.train[0], repeats);
  MultiViewScorer scorer(threads);
  for (int i = 0; i < kWarmUp + repeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    scorer.score(rasterizer, {.views = 1}, RandomStream(0, 0, RandomPurpose::scored_views));
    if (i >= kWarmUp) samples["scoring"].push_back(milliseconds_since(start));
  }

  const BlendWork work = count_blend_work(bench, threads);
  const Json milliseconds = medians(samples);
  const Json blended = {
      {"entries", work.entries},
      {"rows", work.rows},
      {"pairs", work.pairs},
      {"forward", effort_json(blend_effort(work), milliseconds["blend"].get<double>(), limits)},
      {"backward", effort_json(blend_backward_effort(work), milliseconds["blend_backward"].get<double>(), limits)}};
  return {{"name", size.name},
          {"splats", size.splats},
          {"width", size.width},
          {"height", size.height},
          {"blended_per_pixel", static_cast<double>(work.pairs) / static_cast<double>(work.pixels)},
          {"milliseconds", milliseconds},
          {"blend_work", blended}};
}

/// Iterations of one scene that differs from the next in one thing.
Json measure_series(const std::vector<BenchSize>& sizes, Threads& threads, int repeats) {
  Json series = Json::array();
  for (const BenchSize& size : sizes) {
    const BenchScene bench = make_bench_scene(size);
    const auto backbone = make_backbone(bench, threads);
    series.push_back({{"splats", size.splats},
                      {"width", size.width},
                      {"height", size.height},
                      {"threads", threads.count()},
                      {"milliseconds", medians(measure_iterations(*backbone, bench.scene.train[0], repeats))}});
  }
  return series;
}

/// The 60k scene with more or fewer splats, with more or fewer pixels of the same picture, and on fewer threads.
Json measure_scaling(Threads& threads, int repeats) {
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

std::string column(const std::string& text, int width) {
  return std::string(static_cast<std::size_t>(std::max(0, width - static_cast<int>(text.size()))), ' ') + text;
}

std::string fixed(double value, const char* format) {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

/// Milliseconds of a scene's stage in a file of ours; NaN where it has none.
double find_milliseconds(const Json& document, const std::string& scene, const std::string& stage) {
  for (const Json& entry : document.value("scenes", Json::array())) {
    if (!entry.is_object() || entry.value("name", Json()) != scene) continue;
    const Json& value = entry.value("milliseconds", Json::object()).value(stage, Json());
    if (value.is_number()) return value.get<double>();
  }
  return std::nan("");
}

void print_table(const Json& now, const Json* old) {
  constexpr int kLabel = 24, kColumn = 12, kRatio = 9;
  std::printf("%s, %d threads, %s; medians of %d, milliseconds%s\n\n", now["machine"].get<std::string>().c_str(),
              now["threads"].get<int>(), now["instruction_set"].get<std::string>().c_str(), now["repeats"].get<int>(),
              old != nullptr ? "; ratio: old time / new time" : "");
  std::string head(kLabel, ' ');
  for (const Json& scene : now["scenes"]) {
    head += column(scene["name"].get<std::string>(), kColumn);
    if (old != nullptr) head += column("ratio", kRatio);
  }
  std::printf("%s\n", head.c_str());
  for (const auto& [stage, title] : kStages) {
    std::string row = title + std::string(static_cast<std::size_t>(kLabel) - std::string(title).size(), ' ');
    for (const Json& scene : now["scenes"]) {
      const double value = scene["milliseconds"][stage].get<double>();
      row += column(fixed(value, "%.2f"), kColumn);
      if (old == nullptr) continue;
      const double before = find_milliseconds(*old, scene["name"].get<std::string>(), stage);
      row += " " + column(std::isnan(before) || value <= 0 ? "-" : fixed(before / value, "%.2fx"), kRatio - 1);
    }
    std::printf("%s\n", row.c_str());
  }
  std::string density = "splats blended a pixel" + std::string(kLabel - 22, ' ');
  for (const Json& scene : now["scenes"]) {
    density += column(fixed(scene["blended_per_pixel"].get<double>(), "%.1f"), kColumn);
    if (old != nullptr) density += column("", kRatio);
  }
  std::printf("%s\n", density.c_str());
}

void print_work(const Json& now) {
  const Json& limits = now["limits"];
  std::printf("\nlimits of this machine: %.1f GB/s, %.0f billion operations a second (one multiply-add: two)\n",
              1e-9 * limits["bytes_per_second"].get<double>(), 1e-9 * limits["operations_per_second"].get<double>());
  for (const Json& scene : now["scenes"]) {
    const Json& work = scene["blend_work"];
    const double pairs = work["pairs"].get<double>(), rows = work["rows"].get<double>();
    std::printf("%s: %.2f million tile entries, %.2f million rows of 16 pixels, %.0f%% of their pixels blended\n",
                scene["name"].get<std::string>().c_str(), 1e-6 * work["entries"].get<double>(), 1e-6 * rows,
                100 * pairs / (16 * rows));
    for (const char* direction : {"forward", "backward"}) {
      const Json& effort = work[direction];
      std::printf("  blend %-9s%7.0f million operations, %3.0f%% of the limit;%6.0f MB, %3.0f%% of the limit\n",
                  direction, 1e-6 * effort["operations"].get<double>(),
                  100 * effort["share_of_operations"].get<double>(), 1e-6 * effort["bytes"].get<double>(),
                  100 * effort["share_of_bytes"].get<double>());
    }
  }
}

void print_scaling(const Json& scaling) {
  std::printf("\nscaling, milliseconds an iteration\n");
  for (const char* of : {"splats", "pixels", "threads"}) {
    std::string row = std::string("by ") + of + ":";
    for (const Json& point : scaling[of]) {
      const std::string at = std::string(of) == "pixels" ? std::to_string(point["width"].get<int>()) + "x" +
                                                               std::to_string(point["height"].get<int>())
                                                         : std::to_string(point[of].get<int>());
      row += "  " + at + " " + fixed(point["milliseconds"]["iteration"].get<double>(), "%.1f");
    }
    std::printf("%s\n", row.c_str());
  }
}

struct Bench {
  fs::path output;
  fs::path compare;
  std::vector<std::string> scenes;
  std::string instruction_set = "best";
  int threads = 0;
  int repeats = 20;
  bool scaling = false;

  explicit Bench(CLI::App& app) {
    app.add_option("-o,--output", output, "write the figures as JSON")->type_name("FILE");
    app.add_option("--compare", compare, "an earlier JSON; prints ratios")->type_name("FILE");
    app.add_option("--scenes", scenes, "some of 20k, 60k, 200k [all]")->delimiter(',')->type_name("NAME,NAME");
    app.add_option("--repeats", repeats, "iterations to take the median of")->type_name("N")->capture_default_str();
    app.add_flag("--scaling", scaling, "also an iteration against splats, pixels and threads");
    app.add_option("--threads", threads, "threads that work at a time; 0: one a hardware thread")
        ->type_name("N")
        ->capture_default_str();
    app.add_option("--instruction-set", instruction_set, "best, avx512, avx2 or portable")
        ->type_name("NAME")
        ->capture_default_str();
  }

  int run(const std::string& command_line) const {
    if (repeats < 1 || repeats > kMostRepeats) {
      throw UsageError("--repeats must be 1 to " + std::to_string(kMostRepeats));
    }
    if (threads < 0) throw UsageError("--threads must be at least 0");
    std::vector<BenchSize> chosen;
    for (const BenchSize& size : bench_sizes()) {
      if (scenes.empty() || std::find(scenes.begin(), scenes.end(), size.name) != scenes.end()) chosen.push_back(size);
    }
    for (const std::string& name : scenes) {
      const auto known = [&](const BenchSize& size) { return size.name == name; };
      if (std::none_of(chosen.begin(), chosen.end(), known)) {
        throw UsageError("--scenes: no scene '" + name + "'; there are 20k, 60k and 200k");
      }
    }
    hold_instruction_set();
    Json old;
    if (!compare.empty()) {
      old = read_json_file(compare);
      require(old.contains("scenes") && old["scenes"].is_array(), compare.string() + ": no file of splatboost bench");
    }

    Threads pool(threads);
    Json document = {
        {"machine", machine_name()}, {"threads", pool.count()},       {"instruction_set", instruction_set_name()},
        {"date", utc_now()},         {"version", SPLATBOOST_VERSION}, {"command", command_line},
        {"repeats", repeats},        {"scenes", Json::array()}};
    const MachineLimits limits = measure_limits(pool);
    document["limits"] = {{"bytes_per_second", limits.bytes_per_second},
                          {"operations_per_second", limits.operations_per_second}};
    for (const BenchSize& size : chosen) document["scenes"].push_back(measure(size, pool, repeats, limits));
    if (scaling) document["scaling"] = measure_scaling(pool, repeats);
    print_table(document, compare.empty() ? nullptr : &old);
    print_work(document);
    if (scaling) print_scaling(document["scaling"]);
    if (!output.empty()) write_text_atomically(output, document.dump(1) + "\n");
    return 0;
  }

 private:
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
    throw UsageError("--instruction-set: '" + instruction_set + "' is none of best, avx512, avx2, portable");
  }
};

}  // namespace

Command add_bench(CLI::App& program) {
  CLI::App* app = program.add_subcommand("bench", "Time the stages of a training iteration on fixed scenes");
  app->footer("Example: splatboost bench -o new.json --compare old.json");
  const auto bench = std::make_shared<Bench>(*app);
  return {app, [bench](const std::string& command_line) { return bench->run(command_line); }};
}

}  // namespace splatboost::cli

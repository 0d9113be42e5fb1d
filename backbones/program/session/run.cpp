// SPDX-License-Identifier: Apache-2.0
#include "program/session/run.h"
#include "trainer/evaluation/evaluate.h"
#include "trainer/evaluation/result_tables.h"
#include "trainer/support/json_values.h"
#include "trainer/support/process_info.h"

#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "program/session/model_folder.h"
#include "program/session/surface_picture.h"
#include "trainer/backbone_api/memory_estimate.h"
#include "trainer/dataset/smaller_view.h"
#include "trainer/dataset/view_image.h"
#include "trainer/formats/read_scene.h"
#include "trainer/points/initial_points.h"
#include "trainer/points/triangulated_points.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/text.h"
#include "trainer/training/trainer.h"

namespace splatboost::program {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

std::string scene_name(const fs::path& source) {
  // "scene/" and "." have no file name of their own.
  const fs::path whole = fs::absolute(source).lexically_normal();
  if (fs::is_regular_file(whole)) return whole.stem().string();  // a packed scene
  return whole.has_filename() ? whole.filename().string() : whole.parent_path().filename().string();
}

/// The settings in which a checkpoint must match the run, by the names that settings files use.
Json identity_of(const RunOptions& options, bool boost, const Json& constants) {
  Json identity = {{"backbone", options.backbone},
                   {"boost", boost},
                   {"max-primitives", options.max_primitives},
                   {"white-background", options.scene.white_background}};
  for (const auto& [key, value] : constants.items()) identity["backbone: " + key] = value;
  if (boost) {
    const Json settings = boost_settings(options);
    for (const auto& [key, value] : settings.items()) identity["boost: " + key] = value;
  }
  return identity;
}

void tell_memory(const MemoryEstimate& memory, std::size_t primitives, const RunOptions& options,
                 const std::string& label, std::uint64_t resident) {
  const std::size_t cap = options.max_primitives;
  if (!options.quiet) std::fprintf(stderr, "%s: %s\n", label.c_str(), memory_text(memory, primitives, cap).c_str());
  const auto warning = memory_warning(memory, primitives, cap, resident, free_memory_bytes());
  if (warning) std::fprintf(stderr, "%s: %s\n", label.c_str(), warning->c_str());
}

/// The largest known number of primitives of a run.
std::size_t most_primitives(const std::vector<CurvePoint>& curve, std::size_t at_the_end) {
  std::size_t most = at_the_end;
  for (const CurvePoint& point : curve) most = std::max(most, point.primitives);
  return most;
}

/// Saves the photos that renders are compared with. @return the views of a report
std::vector<ReportView> write_truth(const Scene& scene, const fs::path& folder) {
  const std::vector<View>& views = measured_views(scene);
  const std::vector<std::string> names = picture_names(views);
  const fs::path truth = folder / (scene.test.empty() ? "train" : "test") / "truth";
  make_folder(truth);
  std::vector<ReportView> report_views;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const fs::path picture = truth / (names[i] + ".png");
    write_png(picture, views[i].color, views[i].camera.width, views[i].camera.height);
    report_views.push_back({views[i].name, picture});
  }
  return report_views;
}

BackboneContext context_of(Workbench& bench, const RunOptions& options) {
  return {
      bench.scene,           bench.device->threads(), options.seed, options.iterations.value(), options.max_primitives,
      bench.device->device()};
}

/// The training photos at this scale; none if it is 1.
std::vector<View> rescaled_views(const RunOptions& options, double scale) {
  if (scale == 1) return {};
  SceneOptions scene = options.scene;
  scene.photo_scale = scale;
  scene.points = false;
  return read_scene(scene).train;
}

/// Renders from the camera of the first measured view at times from 0 to 1.
std::vector<fs::path> write_moments(Backbone& backbone, const Scene& scene, const fs::path& folder) {
  constexpr int kMoments = 6;
  const Camera& camera = (scene.test.empty() ? scene.train : scene.test).front().camera;
  make_folder(folder / "times");
  std::vector<float> color(3 * static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
  std::vector<fs::path> files;
  for (int i = 0; i < kMoments; ++i) {
    backbone.render(camera, static_cast<float>(i) / (kMoments - 1), std::nullopt, color);
    char name[32];
    std::snprintf(name, sizeof name, "time_%d.png", i);
    files.push_back(folder / "times" / name);
    write_png(files.back(), color, camera.width, camera.height);
  }
  return files;
}

/// Writes depth and normals of some measured views, beside their renders.
std::vector<ReportSurface> write_surfaces(Backbone& backbone, const Scene& scene, const fs::path& folder,
                                          const std::vector<ReportView>& truths, const Threads& threads) {
  constexpr std::size_t kViews = 2;
  const std::vector<View>& views = measured_views(scene);
  std::vector<ReportSurface> surfaces;
  for (std::size_t k = 0; k < std::min(kViews, views.size()); ++k) {
    const std::size_t v = k * (views.size() - 1);  // the first and the last
    const SurfacePicture picture = draw_surface(backbone, views[v], threads);
    const std::string stem = truths[v].truth.stem().string();
    make_folder(folder / "surfaces");
    ReportSurface surface{views[v].name, truths[v].truth, folder / "surfaces" / (stem + "_depth.png"),
                          folder / "surfaces" / (stem + "_normals.png")};
    const Camera& camera = views[v].camera;
    write_png(surface.depth, camera.width, camera.height, 1, std::span<const std::uint8_t>(picture.depth));
    write_png(surface.normals, camera.width, camera.height, 3, std::span<const std::uint8_t>(picture.normals));
    surfaces.push_back(std::move(surface));
  }
  return surfaces;
}

/// Sets Scene::more_points to points that are triangulated from the photos, where the scene has none. Not if they would
/// take more than half of a cap.
void add_points(Workbench& bench, AddedPoints added, const RunOptions& options) {
  Scene& scene = bench.scene;
  if (added == AddedPoints::none || !may_add_points(scene)) return;
  const auto fit = [&](std::size_t points) {
    return options.max_primitives == 0 || 2 * points <= options.max_primitives;
  };
  if (!fit(scene.points.size())) return;
  if (!bench.triangulated) {
    reset_peak_memory();
    const auto start = std::chrono::steady_clock::now();
    const auto triangulate = added == AddedPoints::gaps ? triangulate_points : triangulate_features;
    bench.triangulated = triangulate(scene, bench.device->threads());
    bench.triangulation_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    bench.triangulation_peak_bytes = peak_memory_bytes();
  }
  if (fit(scene.points.size() + bench.triangulated->size())) scene.more_points = *bench.triangulated;
}

/// Throws InputError if the backbone cannot be trained on the scene.
PluggedBackbone backbone_to_train(Workbench& bench, const RunOptions& options, bool boost) {
  const auto require_trainable = find_backbone(options.backbone).require_trainable;
  if (require_trainable != nullptr) require_trainable(bench.scene);
  require_visible_points(bench.scene);
  const Json settings = boost_settings(options);
  bench.scene.more_points = {};
  if (boost) add_points(bench, read_boost_settings(options.backbone, settings)->added_points(), options);
  return make_backbone(options.backbone, context_of(bench, options), options.backbone_settings,
                       boost ? &settings : nullptr);
}

fs::path saved_at(const fs::path& folder, int iteration) {
  return folder / "point_cloud" / ("iteration_" + std::to_string(iteration));
}

}  // namespace

void require_lpips_size(const std::string& view, int width, int height) {
  const auto size = [](int w, int h) { return std::to_string(w) + "×" + std::to_string(h); };
  require(std::min(width, height) >= Lpips::kSmallest, "--lpips needs views of at least " +
                                                           size(Lpips::kSmallest, Lpips::kSmallest) + " pixels; " +
                                                           view + " has " + size(width, height));
}

Workbench make_workbench(const RunOptions& options) {
  require_source(options);
  Workbench bench;
  SceneOptions scene = options.scene;
  scene.seed = options.seed;
  // Before the data, which take time to read: a missing device or file should be reported first.
  bench.device = std::make_unique<ChosenDevice>(options.device, options.threads);
  /// Leaves LPIPS out, with a note, if `body` throws InputError and the options permit that.
  const auto measuring_lpips = [&](auto&& body) {
    try {
      body();
    } catch (const InputError& error) {
      if (!options.lpips_if_possible) throw;
      bench.lpips.reset();
      if (!options.quiet) std::fprintf(stderr, "note: LPIPS is not measured: %s\n", printable(error.what()).c_str());
    }
  };
  if (!options.lpips.empty()) measuring_lpips([&] { bench.lpips = std::make_unique<Lpips>(options.lpips); });
  bench.scene = read_scene(scene);
  if (!options.quiet) {
    for (const std::string& note : bench.scene.notes) std::fprintf(stderr, "note: %s\n", printable(note).c_str());
  }
  if (!bench.lpips) return bench;
  measuring_lpips([&] {
    for (const View& view : measured_views(bench.scene)) {
      require_lpips_size("view '" + view.name + "'", view.camera.width, view.camera.height);
    }
  });
  return bench;
}

std::string run_label(bool boost) { return boost ? "boosted" : "baseline"; }

std::string config_of_run(Workbench& bench, const nlohmann::json& recorded, const RunOptions& options, bool boost) {
  const PluggedBackbone plugged = backbone_to_train(bench, options, boost);
  return config_text(recorded, options, boost, &plugged, &bench.scene);
}

RunOutcome run_once(Workbench& bench, const nlohmann::json& recorded, const RunOptions& options, bool boost,
                    const fs::path& folder, const std::string& command,
                    const std::function<void(const std::string&)>& take_folder) {
  // Measure each run's own peak memory: return what an earlier run freed to the system first.
  if (bench.lpips) bench.lpips->release_memory();
  malloc_trim(0);
  reset_peak_memory();
  const std::uint64_t resident = resident_memory_bytes();

  const PluggedBackbone plugged = backbone_to_train(bench, options, boost);
  Backbone& backbone = *plugged.backbone;
  const std::string config = config_text(recorded, options, boost, &plugged, &bench.scene);
  bench.scene.train_halves.clear();
  if (plugged.coarse_until > 0) bench.scene.train_halves = half_views(bench.scene.train, bench.device->threads());
  bench.scene.train_rescaled = rescaled_views(options, backbone.photo_scale());
  const MemoryEstimate memory =
      estimate_memory(bench.scene, resident, backbone.bytes_per_primitive(), backbone.bytes_per_pixel());
  // On a GPU, primitives take no host memory, which is what is estimated.
  const bool on_host = !bench.device->device().is_cuda();

  TrainOptions train_options;
  train_options.iterations = options.iterations.value();
  train_options.seed = options.seed;
  train_options.model = folder;
  train_options.coarse_iterations = static_cast<int>(std::lround(plugged.coarse_until * train_options.iterations));
  train_options.save_iterations = options.save_iterations;
  train_options.checkpoint_iterations = options.checkpoint_iterations;
  train_options.resume = options.resume;
  train_options.identity = identity_of(options, boost, backbone.config());
  train_options.label = run_label(boost);
  train_options.on_start = [&](std::size_t primitives) {
    take_folder(config);
    write_config(folder, config);
    write_cameras(folder, bench.scene);
    if (on_host) tell_memory(memory, primitives, options, train_options.label, resident);
    if (const std::size_t more = bench.scene.more_points.size(); more > 0 && !options.quiet) {
      std::fprintf(stderr, "note: this run starts from %zu more points, triangulated from the photos\n", more);
    }
    if (!options.quiet && !backbone.uses_time() && moves(bench.scene)) {
      std::fprintf(stderr,
                   "note: the training views have different times, which backbone %s ignores "
                   "(docs/formats.md, Scenes that move)\n",
                   options.backbone.c_str());
    }
  };
  train_options.quiet = options.quiet;
  const auto results_of = [&](const TrainOutcome& trained) {
    Results results = results_of_run(options, boost, bench.scene, *bench.device, command);
    results.psnr = results.ssim = results.psnr_beta1 = results.fps = std::nan("");  // not measured yet
    results.iterations = options.iterations.value();
    results.primitives = backbone.primitives();
    results.train_seconds = trained.seconds;
    results.stage_seconds = trained.stage_seconds;
    if (on_host) results.estimated_memory_bytes = memory.bytes(most_primitives(trained.curve, results.primitives));
    results.storage_bytes = trained.storage_bytes;
    results.curve = trained.curve;
    if (bench.scene.more_points.size() > 0) {
      results.peak_memory_bytes = std::max(results.peak_memory_bytes, bench.triangulation_peak_bytes);
      results.train_seconds += bench.triangulation_seconds;
      results.stage_seconds["triangulation"] = bench.triangulation_seconds;
      for (CurvePoint& point : results.curve) point.seconds += bench.triangulation_seconds;
    }
    return results;
  };
  bool noted = false;
  train_options.on_end = [&](const TrainOutcome& trained) {
    try {
      write_results(folder / kTrainingFile, results_of(trained));
      noted = true;
    } catch (const std::runtime_error&) {
      // The model is more important: it is exported first, then this is tried again.
    }
  };
  const TrainOutcome trained = train(backbone, bench.scene, train_options);
  const RunOutcome interrupted{trained.interrupted_by, trained.iteration, trained.checkpoint, {}, {}};
  if (!trained.checkpoint.empty()) return interrupted;
  Results results = results_of(trained);
  if (!noted) write_results(folder / kTrainingFile, results);
  // Where one file could not be written, the many of the measurement might fail too, and hide the reason.
  if (!trained.unsaved.empty()) {
    throw std::runtime_error(trained.unsaved +
                             "; the model is trained to its end; measure it with: splatboost eval -m " +
                             shell_word(folder.string()));
  }
  if (trained.interrupted_by != 0) return interrupted;
  return measure_run(bench, backbone, folder, std::move(results));
}

Results results_of_run(const RunOptions& options, bool boost, const Scene& scene, ChosenDevice& device,
                       const std::string& command) {
  Results results;
  results.backbone = options.backbone;
  results.boost = boost;
  results.peak_memory_bytes = peak_memory_bytes();
  results.device = device.name();
  results.machine = machine_name();
  results.threads = device.threads().count();
  results.seed = options.seed;
  results.version = SPLATBOOST_VERSION;
  results.command = command;
  results.date = utc_now();
  results.source = scene_name(options.scene.source);
  results.width = scene.train[0].camera.width;
  results.height = scene.train[0].camera.height;
  return results;
}

RunOutcome measure_run(Workbench& bench, Backbone& backbone, const fs::path& folder, Results trained) {
  RunOutcome outcome;
  outcome.run.label = run_label(trained.boost);
  outcome.run.results = std::move(trained);
  Results& results = outcome.run.results;
  outcome.run.renders = folder / (bench.scene.test.empty() ? "train" : "test") / "renders";
  evaluate(backbone, bench.scene, bench.lpips.get(), outcome.run.renders, results);
  outcome.views = write_truth(bench.scene, folder);
  if (backbone.uses_time())
    outcome.run.moments = write_moments(backbone, bench.scene, outcome.run.renders.parent_path());
  if (backbone.trains_surfaces()) {
    outcome.run.surfaces = write_surfaces(backbone, bench.scene, outcome.run.renders.parent_path(), outcome.views,
                                          bench.device->threads());
  }
  write_report(folder / "report.html", results.source + " — " + results.backbone + ", " + outcome.run.label,
               {outcome.run}, outcome.views);
  write_results(folder / "results.json", results);
  std::error_code ignored;
  fs::remove(folder / kTrainingFile, ignored);
  return outcome;
}

std::optional<Results> trained_results(const fs::path& folder) {
  const bool measured = is_file(folder / "results.json");
  const fs::path file = folder / (measured ? "results.json" : kTrainingFile);
  if (!is_file(file)) return std::nullopt;
  Results results = read_results(file);
  // kTrainingFile is written before the model.
  if (!measured) results.storage_bytes = model_bytes(saved_at(folder, results.iterations));
  return results.storage_bytes > 0 ? std::optional(std::move(results)) : std::nullopt;
}

RunOutcome measure_saved_run(Workbench& bench, const RunOptions& options, const fs::path& folder, Results trained) {
  const PluggedBackbone plugged =
      load_model(bench, options, saved_at(folder, trained.iterations), trained_beta(folder, read_config(folder)));
  return measure_run(bench, *plugged.backbone, folder, std::move(trained));
}

bool is_machine_of(const Results& results, ChosenDevice& device) {
  return results.device == device.name() && results.machine == machine_name() &&
         results.threads == device.threads().count();
}

Results read_results(const fs::path& path) {
  const Json document = read_json_file(path);
  try {
    return results_from_json(document);
  } catch (const InputError& error) {
    throw InputError(path.string() + ": " + error.what());
  }
}

void write_results(const fs::path& path, const Results& results) {
  write_text_atomically(path, to_json(results).dump(2) + "\n");
}

std::string results_table(const Results& results) {
  const std::vector<ResultRow> rows = result_rows(std::span(&results, 1));
  // Count characters rather than bytes: skip continuation bytes of UTF-8.
  const auto width = [](const std::string& text) {
    return std::count_if(text.begin(), text.end(),
                         [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; });
  };
  std::ptrdiff_t label_width = 0;
  std::ptrdiff_t value_width = 0;
  for (const ResultRow& row : rows) {
    label_width = std::max(label_width, width(row.label));
    value_width = std::max(value_width, width(row.values.at(0)));
  }
  std::string table;
  for (const ResultRow& row : rows) {
    table += row.label + std::string(static_cast<std::size_t>(label_width - width(row.label)), ' ') + "  " +
             std::string(static_cast<std::size_t>(value_width - width(row.values[0])), ' ') + row.values[0] + "\n";
  }
  return table;
}

PluggedBackbone load_model(Workbench& bench, const RunOptions& options, const fs::path& saved,
                           std::optional<float> beta) {
  PluggedBackbone plugged =
      make_backbone(options.backbone, context_of(bench, options), options.backbone_settings, nullptr);
  plugged.backbone->import_model(saved);
  require(plugged.backbone->primitives() > 0, saved.string() + ": this model has no primitives; train again");
  plugged.backbone->rasterizer_hook().set_beta(beta);
  plugged.beta = beta;
  return plugged;
}

std::uint64_t model_bytes(const fs::path& saved) {
  std::uint64_t bytes = 0;
  std::error_code none;
  for (const auto& file : fs::directory_iterator(saved, none)) {
    if (!is_working_file(file.path())) bytes += file.file_size();
  }
  return bytes;
}

int end_interrupted(const RunOutcome& outcome, const std::string& command) {
  if (outcome.checkpoint.empty()) {
    std::fprintf(stderr, "stopped after the last iteration; go on with: %s\n", command.c_str());
  } else {
    std::fprintf(stderr, "interrupted after iteration %d; resume with: %s\n", outcome.iteration, command.c_str());
  }
  return exit_code_of_signal(outcome.interrupted_by);
}

int exit_code_of_signal(int signal_number) { return 128 + signal_number; }

}  // namespace splatboost::program

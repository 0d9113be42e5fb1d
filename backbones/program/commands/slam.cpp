// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstdio>
#include <exception>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "program/command_line/shared_options.h"
#include "program/commands/commands.h"
#include "program/session/chosen_device.h"
#include "program/session/model_folder.h"
#include "program/session/run.h"
#include "program/slam/slam_results.h"
#include "program/slam/slam_run.h"
#include "splatboost/errors.h"
#include "trainer/dataset/view_image.h"
#include "trainer/evaluation/metrics.h"
#include "trainer/report/report.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/process_info.h"
#include "trainer/support/text.h"
#include "trainer/training/stop_signals.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

struct Slam {
  explicit Slam(CLI::App& app) : set(app), own(app) {
    options.backbone = "photo-slam";
    own.set_group("Data");
    own.add("-s,--source", options.scene.source,
            "sequence: Replica, TUM RGB-D, EuRoC (stereo, or cam0 alone), pictures with calibration.json, or a video "
            "with --calibration; without depth, lengths have no unit")
        ->type_name("DIR|VIDEO");
    add_model_option(set, options, "output folder");
    own.add("--calibration", slam.sequence.calibration, "camera calibration to use instead of the dataset's own")
        ->type_name("JSON");
    own.add("-r,--resolution", options.scene.resolution,
            std::string("resolution of the mapped images; ") + kResolutionHelp)
        ->type_name("N");
    own.add("--first-frame", slam.sequence.first, "begin with this frame")->type_name("N")->capture_default_str();
    own.add("--frames", slam.sequence.count, "maximum number of frames; 0: all")->type_name("N")->capture_default_str();
    own.add("--stride", slam.sequence.stride, "use every N-th frame")->type_name("N")->capture_default_str();
    own.set_group("Tracking");
    own.add("--features", slam.tracker.features, "features per frame")->type_name("N")->capture_default_str();
    own.add("--max-depth", slam.tracker.farthest_depth, "ignore larger depths of depth images, metres")
        ->type_name("X")
        ->capture_default_str();
    own.add("--no-loops", no_loops, "do not detect loops");
    own.set_group("Mapping");
    set.set_group("Mapping");
    set.add("--backbone", options.backbone, "method used for mapping", false)->type_name("NAME")->capture_default_str();
    set.add("--boost,!--no-boost", options.boost, "map accelerated (default), or as published", false);
    set.add("--iterations", options.iterations,
            "total iterations of the mapper; more if the sequence takes more than half of them [30000]")
        ->type_name("N");
    own.add("--seconds", slam.seconds,
            "instead of --iterations: end when X seconds have passed and the sequence has ended")
        ->type_name("X");
    own.add("--lockstep", slam.lockstep,
            "N iterations per keyframe in a fixed order; the same seed gives the same bytes")
        ->type_name("N");
    own.add("--initial-keyframes", slam.initial_keyframes, "number of keyframes needed to begin mapping")
        ->type_name("N")
        ->capture_default_str();
    set.add("--max-primitives", options.max_primitives, "hard cap on primitives; 0: none")
        ->type_name("N")
        ->capture_default_str();
    set.add("--seed", options.seed, "seed of all random numbers")->type_name("N")->capture_default_str();
    add_boost_options(set, options);
    add_machine_options(set, options);
    add_lpips_option(set, options);
    add_config_option(set, options);
  }

  /// Reads --config, which may be config.json of a run. Options that only this command has are in "slam".
  void read_settings() {
    if (options.config.empty()) return;
    const std::string place = options.config.string();
    Json settings = read_settings_file(options.config);
    settings.erase("source");
    if (settings.contains("slam")) {
      settings.erase("resolution");
      require(settings["slam"].is_object(), place + ": slam must be an object");
      own.overlay(settings["slam"], place + ": slam", {});
    }
    apply_settings(settings, place, set, options);
    // What the command line says about the end of the run replaces what the file says.
    if (!own.given("seconds") && (set.given("iterations") || own.given("lockstep"))) slam.seconds.reset();
    if (!own.given("lockstep") && own.given("seconds")) slam.lockstep.reset();
  }

  /// The source in config.json is the keyframes, so that commands that read scenes can open the run.
  std::string config_of(const PluggedBackbone& plugged) const {
    Json config = Json::parse(config_text(set.record(), options, options.boost, &plugged));
    config["slam"] = own.record();
    config["source"] = fs::absolute(options.model / "keyframes").lexically_normal().string();
    config["resolution"] = 1;  // the keyframes have the size that was mapped
    return config.dump(2) + "\n";
  }

  void check() {
    const auto usage = [](bool holds, const std::string& what) {
      if (!holds) throw UsageError(what);
    };
    usage(!options.scene.source.empty(), "no sequence given: name its folder with -s/--source");
    usage(!options.model.empty(), "no output folder given: name it with -m/--model");
    check_options(set, options);
    check_resolution(options.scene.resolution.value_or(-1));
    check_boost_options(set, options);
    own.check(!slam.lockstep || *slam.lockstep >= 0, "lockstep", "must be at least 0");
    own.check(!slam.seconds || (*slam.seconds >= 0 && std::isfinite(*slam.seconds)), "seconds", "must be at least 0");
    usage(!(slam.lockstep && slam.seconds),
          "--lockstep and --seconds cannot be combined: a time limit is not reproducible");
    usage(!(slam.seconds && set.given("iterations")),
          "--iterations and --seconds cannot be combined: both set the end of mapping");
    own.check(slam.initial_keyframes >= 1, "initial-keyframes", "must be at least 1");
    own.check(slam.tracker.features >= 100 && slam.tracker.features <= 20000, "features", "must be 100 to 20000");
    own.check(slam.tracker.farthest_depth > slam.tracker.nearest_depth && std::isfinite(slam.tracker.farthest_depth),
              "max-depth", "must be above " + std::to_string(slam.tracker.nearest_depth));
    own.check(slam.sequence.first >= 0, "first-frame", "must be at least 0");
    own.check(slam.sequence.count >= 0, "frames", "must be at least 0");
    own.check(slam.sequence.stride >= 1, "stride", "must be at least 1");
    slam.tracker.loops = !no_loops;
    slam.sequence.source = options.scene.source;
  }

  PluggedBackbone make_mapper(const Scene& scene, ChosenDevice& device) const {
    const BackboneContext context{
        scene, device.threads(), options.seed, options.iterations.value(), options.max_primitives, device.device(),
        true};
    const Json boost = boost_settings(options);
    PluggedBackbone plugged =
        make_backbone(options.backbone, context, options.backbone_settings, options.boost ? &boost : nullptr);
    require(dynamic_cast<const OnlineBackbone*>(plugged.backbone.get()) != nullptr,
            "--backbone: " + options.backbone + " cannot train on views that arrive during training; use photo-slam");
    return plugged;
  }

  /// Makes a mapper for a cube and discards it, so that settings that it refuses throw InputError before tracking.
  void check_mapper(ChosenDevice& device) const {
    Scene cube;
    cube.extent = 1;
    cube.white_background = options.scene.white_background;
    cube.train.resize(1);
    View& view = cube.train.front();
    view.camera.width = view.camera.height = 16;
    view.camera.fx = view.camera.fy = 16;
    view.camera.cx = view.camera.cy = 8;
    view.camera.camera_from_world[3].z = 4;
    view.color.resize(3 * 16 * 16);
    for (int corner = 0; corner < 8; ++corner) {
      for (int axis = 0; axis < 3; ++axis) cube.points.positions.push_back((corner >> axis & 1) == 0 ? -1.0f : 1.0f);
    }
    cube.points.colors.resize(cube.points.positions.size());
    make_mapper(cube, device);
  }

  int run(const std::string& command_line) {
    read_settings();
    check();
    require_ours_or_empty(options.model);
    require_only_results(options.model);
    require_no_comparison(options.model);
    require_inputs_elsewhere(options.model, options, slam.sequence.calibration);
    require_writable_folder(options.model);
    slam.keep_untrained = !holds_run(options.model);  // which an untrained model must not replace
    ChosenDevice device(options.device, options.threads);
    check_mapper(device);
    std::unique_ptr<Lpips> lpips;
    if (!options.lpips.empty()) lpips = std::make_unique<Lpips>(options.lpips);
    const std::unique_ptr<Sequence> sequence = open_sequence(slam.sequence);
    if (lpips) {
      const Calibration& camera = sequence->calibration();
      const ImageSize size = target_size(camera.width, camera.height, options.scene.resolution.value_or(-1));
      require_lpips_size("the mapped image", size.width, size.height);
    }
    std::vector<std::string> notes = sequence->notes();
    if (!sequence->calibration().has_depth()) {
      notes.push_back(
          options.scene.source.string() +
          ": has no depth images, or its calibration has no depth_scale; tracked without depth: the unit of "
          "length is the median depth where the map begins");
    }
    for (const std::string& note : notes) {
      if (!options.quiet) std::fprintf(stderr, "note: %s\n", printable(note).c_str());
    }

    reset_peak_memory();
    std::optional<FolderLock> lock;
    const StopSignals signals;
    const auto stopped = [&] { return signals.caught() != 0; };
    SlamRun mapping(
        *sequence, slam, options,
        [&](const Scene& scene) {
          PluggedBackbone plugged = make_mapper(scene, device);
          lock = take_model_folder(options.model);
          write_config(options.model, config_of(plugged));
          return plugged;
        },
        stopped);
    const SlamOutcome outcome = mapping.run();
    if (outcome.failure) keep_after_failure(mapping, outcome, *sequence, device, command_line);
    if (!mapping.has_model()) {
      std::fprintf(stderr, "interrupted %s, before mapping began; %s\n", place_of(outcome, *sequence).c_str(),
                   nothing_written().c_str());
      return exit_code_of_signal(signals.caught());
    }
    const std::size_t measured = write(mapping, outcome, *sequence, device, lpips.get(), command_line, stopped);
    if (!stopped()) return 0;
    const std::string when =
        outcome.complete ? "while measuring, after " + counted(measured, "frame") : place_of(outcome, *sequence);
    std::fprintf(stderr, "interrupted %s; %s; measure the model with: splatboost eval -m %s\n", when.c_str(),
                 kept(mapping).c_str(), shell_word(options.model.string()).c_str());
    return exit_code_of_signal(signals.caught());
  }

  static std::string place_of(const SlamOutcome& outcome, const Sequence& sequence) {
    return "after frame " + std::to_string(outcome.frames.size()) + " of " + std::to_string(sequence.size()) +
           ", iteration " + std::to_string(outcome.iterations);
  }

  std::string kept(const SlamRun& mapping) const {
    return "trajectory, " + counted(mapping.scene().train.size(), "keyframe") + ", model and results so far are in " +
           options.model.string();
  }

  std::string nothing_written() const {
    if (slam.keep_untrained) return "nothing was written";
    return "nothing was written, and " + options.model.string() + " still holds the earlier run";
  }

  /// Writes the output so far and throws the error of the run again, with a note about that output.
  [[noreturn]] void keep_after_failure(SlamRun& mapping, const SlamOutcome& outcome, Sequence& sequence,
                                       ChosenDevice& device, const std::string& command_line) const {
    std::string what = "out of memory";
    bool memory = true;
    try {
      std::rethrow_exception(outcome.failure);
    } catch (const std::bad_alloc&) {
    } catch (const DeviceMemoryError& error) {
      what = error.what();
    } catch (const std::exception& error) {
      what = error.what();
      memory = false;
    }
    const bool trained = mapping.has_model();
    std::string saved = trained ? kept(mapping) : nothing_written();
    try {
      if (trained) write(mapping, outcome, sequence, device, nullptr, command_line, [] { return true; });
    } catch (const std::exception& reason) {
      saved = "not all results could be saved: " + std::string(reason.what());
    }
    what += " " + place_of(outcome, sequence) + ", with " +
            counted(trained ? mapping.backbone().primitives() : 0, "primitive") + "; " + saved;
    if (memory) what += "; lower --resolution or set --max-primitives";
    throw std::runtime_error(what);
  }

  /// @return number of measured frames
  std::size_t write(SlamRun& mapping, const SlamOutcome& outcome, Sequence& sequence, ChosenDevice& device,
                    Lpips* lpips, const std::string& command_line, const std::function<bool()>& stopped) const {
    const fs::path& folder = options.model;
    Results results = results_of_run(options, options.boost, mapping.scene(), device, command_line);
    results.iterations = outcome.iterations;
    results.primitives = mapping.backbone().primitives();
    results.train_seconds = outcome.mapping_seconds;
    results.stage_seconds = outcome.stage_seconds;
    results.curve = outcome.curve;
    write_tracking(mapping, outcome, sequence, folder);  // first, because exporting the model may run out of memory
    write_cameras(folder, mapping.scene());
    const fs::path model = folder / "point_cloud" / ("iteration_" + std::to_string(outcome.iterations));
    make_folder(model);
    results.storage_bytes = mapping.backbone().export_model(model);
    const std::optional<TrajectoryError> error = trajectory_error(mapping, outcome, sequence);
    std::vector<ReportView> views;
    const auto measure_and_write = [&](const std::function<bool()>& ends) {
      const Json keyframes = measure_frames(mapping, outcome, sequence, options.scene.resolution.value_or(-1), lpips,
                                            folder, ends, results, views);
      Json json = to_json(results);
      json["slam"] = slam_json(mapping, outcome, sequence, error, keyframes);
      write_slam_report(folder, run_label(options.boost), results, json, views,
                        report_tracks(mapping, outcome, sequence, error));
      write_text_atomically(folder / "results.json", json.dump(2) + "\n");
      return json;
    };
    // Without any measured frame, so that `eval` can measure the model if this process is killed while it measures.
    measure_and_write([] { return true; });
    const Json json = measure_and_write(stopped);
    if (outcome.complete && !stopped()) print(json, results);
    return results.views.size();
  }

  Json slam_json(const SlamRun& mapping, const SlamOutcome& outcome, const Sequence& sequence,
                 const std::optional<TrajectoryError>& error, const Json& keyframes) const {
    std::map<TrackState, std::size_t> states;
    for (const TrackedFrame& frame : outcome.frames) ++states[frame.state];
    return {{"complete", outcome.complete},
            {"frames", sequence.size()},
            {"tracked", states[TrackState::tracked]},
            {"lost", states[TrackState::lost]},
            {"dropped", states[TrackState::dropped]},
            {"waiting", states[TrackState::waiting]},
            {"keyframes", keyframes},
            {"map_points", mapping.tracker().map_points()},
            {"loops", mapping.tracker().loops()},
            {"depth", sequence.calibration().has_depth()},
            {"ate_rmse", error ? Json(error->ate_rmse) : Json(nullptr)},
            {"ate_alignment", !error                               ? Json(nullptr)
                              : sequence.calibration().has_depth() ? Json("rigid")
                                                                   : Json("similarity")},
            {"ate_scale", error ? Json(error->scale) : Json(nullptr)},
            {"path_length", error ? Json(error->path) : Json(nullptr)},
            {"tracking_fps",
             outcome.tracking_seconds > 0 ? static_cast<double>(outcome.frames.size()) / outcome.tracking_seconds : 0},
            {"sequence_seconds", outcome.sequence_seconds},
            {"iterations_in_sequence", outcome.iterations_in_sequence},
            {"lockstep", slam.lockstep ? Json(*slam.lockstep) : Json(nullptr)}};
  }

  void print(const Json& json, const Results& results) const {
    std::printf("%s", results_table(results).c_str());
    for (const std::string& line : tracking_lines(json)) std::printf("%s\n", line.c_str());
    const Json& s = json.at("slam");
    const auto tracked = s.at("tracked").get<std::size_t>();
    if (2 * tracked < s.at("frames").get<std::size_t>()) {
      std::fprintf(stderr,
                   "warning: less than half of the frames were tracked; check the calibration (focal lengths, "
                   "depth_scale) and that neighbouring frames overlap\n");
    }
    std::printf("report: %s\n", (options.model / "report.html").c_str());
  }

  RunOptions options;
  SlamOptions slam;
  bool no_loops = false;
  OptionSet set, own;  ///< options shared with training, and those of this command only
};

}  // namespace

Command add_slam(CLI::App& program) {
  CLI::App* app = program.add_subcommand("slam", "Track a camera and map the scene while it moves");
  app->footer("Example: splatboost slam -s SEQUENCE -m OUT --iterations 3000");
  const auto slam = std::make_shared<Slam>(*app);
  return {app, [slam](const std::string& command_line) { return slam->run(command_line); }};
}

}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
#include "trainer/training/trainer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <new>
#include <numeric>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "splatboost/errors.h"
#include "splatboost/random.h"
#include "trainer/evaluation/evaluate.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"
#include "trainer/support/text.h"
#include "trainer/training/data_identity.h"
#include "trainer/training/progress.h"
#include "trainer/training/stop_signals.h"

namespace splatboost {
namespace {

using Json = nlohmann::json;

// Weight of the newest loss in the shown mean: views differ in difficulty, so about 20 of them are averaged.
constexpr double kLossWeight = 0.05;

constexpr std::string_view kTrainerEntry = "trainer";
constexpr char kCheckpointEnding[] = ".ckpt";
constexpr char kDataKey[] = "data";  // key of data_identity() in the identity

/// The order in which the views of one epoch are seen.
void shuffle_epoch(std::uint64_t epoch, std::size_t views, std::uint64_t seed, std::vector<std::size_t>& order) {
  order.resize(views);
  std::iota(order.begin(), order.end(), std::size_t{0});
  const RandomStream random(seed, epoch, RandomPurpose::view_order);
  for (std::size_t i = views; i > 1; --i) std::swap(order[i - 1], order[random.below(i, i)]);
}

std::uint64_t epoch_of(int iteration, std::size_t views) { return static_cast<std::uint64_t>(iteration - 1) / views; }

bool contains(const std::vector<int>& numbers, int number) {
  return std::find(numbers.begin(), numbers.end(), number) != numbers.end();
}

/// Whether the curve is sampled at this iteration: evenly spaced, and at the last one. Samples are taken one iteration
/// before the round numbers, at which backbones reset opacities: right after a reset, the quality would mean nothing.
bool samples_curve_at(int iteration, int total, int points) {
  if (iteration == total) return true;
  if (points <= 0) return false;
  // True if floor(iteration · points / total) increases with the next iteration.
  const auto passed = [&](int i) { return static_cast<long long>(i) * points / total; };
  return iteration + 1 < total && passed(iteration + 1) != passed(iteration);
}

std::string iteration_name(int iteration) { return "iteration_" + std::to_string(iteration); }

Json curve_to_json(const std::vector<CurvePoint>& curve) {
  Json json = Json::array();
  for (const CurvePoint& point : curve) {
    json.push_back(
        {point.iteration, point.seconds, point.loss, point.primitives, point.psnr ? Json(*point.psnr) : Json(nullptr)});
  }
  return json;
}

std::vector<CurvePoint> curve_from_json(const Json& json) {
  std::vector<CurvePoint> curve;
  for (const Json& row : json) {
    CurvePoint point;
    point.iteration = row.at(0).get<int>();
    point.seconds = row.at(1).get<double>();
    point.loss = row.at(2).get<double>();
    point.primitives = row.at(3).get<std::size_t>();
    if (!row.at(4).is_null()) point.psnr = row.at(4).get<double>();
    curve.push_back(point);
  }
  return curve;
}

std::string shown(const Json& value) { return value.is_string() ? value.get<std::string>() : value.dump(); }

/// How the run of a checkpoint differs from this one, in words; empty: it is the same. A checkpoint of another run is
/// refused: resuming it would mix data or settings without a sign of it in the results.
std::string run_difference(const Json& saved, const Json& wanted) {
  for (const auto& [key, value] : wanted.items()) {
    if (key == kDataKey) continue;
    const Json other = saved.contains(key) ? saved.at(key) : Json("none");
    if (other != value) {
      return key + " = " + shown(other) + ", but this run has " + shown(value) +
             "; resume with the settings of that run";
    }
  }
  const std::string difference = data_difference(saved.at(kDataKey), wanted.at(kDataKey));
  return difference.empty() ? "" : difference + "; resume with the data and the options of that run";
}

/// One run of the training loop and its state.
class Run {
 public:
  Run(Backbone& backbone, const Scene& scene, const TrainOptions& options)
      : backbone_(backbone), scene_(scene), options_(options), identity_(options.identity) {
    identity_["iterations"] = options.iterations;
    identity_["seed"] = options.seed;
    identity_["training views"] = scene.train.size();
    identity_["image size"] =
        std::to_string(scene.train[0].camera.width) + "x" + std::to_string(scene.train[0].camera.height);
    identity_[kDataKey] = data_identity(scene);
  }

  TrainOutcome train() {
    const bool is_folder = std::filesystem::is_directory(options_.resume);
    const std::filesystem::path checkpoint = is_folder ? latest_checkpoint() : options_.resume;
    if (!checkpoint.empty()) restore(checkpoint);
    const int first = outcome_.iteration + 1;
    const double seconds_before = outcome_.seconds;
    if (options_.on_start) options_.on_start(backbone_.primitives());
    make_folder(options_.model / "point_cloud");

    std::vector<std::size_t> order;
    std::uint64_t order_epoch = 0;
    Progress progress(options_.label, options_.iterations, outcome_.iteration, options_.quiet);
    StopSignals signals;
    for (int iteration = first; iteration <= options_.iterations; ++iteration) {
      const auto start = std::chrono::steady_clock::now();
      const std::size_t views = scene_.train.size();
      const std::uint64_t epoch = epoch_of(iteration, views);
      if (order.empty() || epoch != order_epoch) {
        shuffle_epoch(epoch, views, options_.seed, order);
        order_epoch = epoch;
      }
      const bool coarse = iteration <= options_.coarse_iterations && !scene_.train_halves.empty();
      const View& view =
          (coarse ? scene_.train_halves : scene_.train)[order[static_cast<std::size_t>(iteration - 1) % views]];
      const bool last = iteration == options_.iterations;
      const bool samples = samples_curve_at(iteration, options_.iterations, options_.curve_points);
      const bool saves = contains(options_.save_iterations, iteration);
      const bool checkpoints = contains(options_.checkpoint_iterations, iteration);
      const double loss = saving_the_model(iteration, [&] { return backbone_.train_step(iteration, view); });
      if (last) backbone_.finish();
      // Only training is timed, so all pending training must be done before other work starts.
      if (samples || saves || checkpoints) backbone_.wait();
      outcome_.seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();

      if (!std::isfinite(loss)) {
        throw std::runtime_error(
            "the loss is not finite at iteration " + std::to_string(iteration) + " (view " + view.name +
            "; on a GPU, possibly shortly before); lower the learning rates in --config, or report this");
      }
      outcome_.iteration = iteration;
      loss_ = std::isnan(loss_) ? loss : loss_ + kLossWeight * (loss - loss_);
      progress.update(iteration, loss_, backbone_.primitives(), outcome_.seconds - seconds_before);
      if (samples) saving_the_model(iteration, [&] { sample_curve(); });
      if (last) break;
      if (saves) save_on_the_way(progress, [&] { export_model(); });
      if (checkpoints) save_on_the_way(progress, [&] { save(); });
      if (signals.caught() != 0) {
        outcome_.interrupted_by = signals.caught();
        outcome_.checkpoint = save_or_export();
        break;
      }
    }
    outcome_.stage_seconds = stage_seconds();
    if (outcome_.interrupted_by == 0) {
      if (options_.on_end) options_.on_end(outcome_);
      outcome_.storage_bytes = export_model();
      // After the model, which is more important if the disk is full.
      if (contains(options_.checkpoint_iterations, outcome_.iteration)) attempt([&] { save(); });
      outcome_.interrupted_by = signals.caught();  // since the last iteration
    }
    return std::move(outcome_);
  }

 private:
  /// Calls the body. If the device runs out of memory, exports the model as it is and throws DeviceMemoryError again.
  template <class Body>
  std::invoke_result_t<const Body&> saving_the_model(int iteration, const Body& body) {
    try {
      return body();
    } catch (const DeviceMemoryError& error) {
      outcome_.iteration = iteration;
      const std::string saved = export_so_far();
      throw DeviceMemoryError("iteration " + std::to_string(iteration) + ": " + error.what() + ", with " +
                              std::to_string(backbone_.primitives()) + " primitives; " + saved +
                              "; lower --resolution or set --max-primitives");
    }
  }

  /// Exports the model of a run that ends early. @return where it is, or why it could not be saved, for a message
  std::string export_so_far() {
    try {
      export_model();
    } catch (const std::exception& reason) {
      return "the model could not be saved: " + std::string(reason.what());
    }
    return "the model so far is in " + model_folder().string();
  }

  /// Calls the body, which saves what the run can do without. If it fails, the outcome keeps the reason, unless it has
  /// an earlier one. @return the reason; empty: the body succeeded
  template <class Body>
  std::string attempt(const Body& body) {
    std::string reason;
    try {
      body();
    } catch (const std::bad_alloc&) {
      reason = iteration_name(outcome_.iteration) + ": cannot be saved: out of memory";
    } catch (const std::exception& error) {
      reason = error.what();
    }
    if (outcome_.unsaved.empty()) outcome_.unsaved = reason;
    return reason;
  }

  /// The same before the end of the run, with a warning: hours of training are worth more than a file on the way.
  template <class Body>
  void save_on_the_way(Progress& progress, const Body& body) {
    const std::string reason = attempt(body);
    if (!reason.empty()) progress.note("warning: " + printable(reason) + "; training goes on");
  }

  /// Writes the checkpoint of an interrupted run. If that fails, exports the model, which is smaller, and throws.
  std::filesystem::path save_or_export() {
    try {
      return save();
    } catch (const std::exception& error) {
      throw std::runtime_error("interrupted after iteration " + std::to_string(outcome_.iteration) + "; " +
                               error.what() + "; " + export_so_far());
    }
  }

  void sample_curve() {
    CurvePoint point;
    point.iteration = outcome_.iteration;
    point.seconds = outcome_.seconds;
    point.loss = loss_;
    point.primitives = backbone_.primitives();
    if (options_.curve_points > 0 && options_.curve_views > 0) {
      point.psnr = quick_psnr(backbone_, scene_, options_.curve_views);
    }
    outcome_.curve.push_back(point);
  }

  std::filesystem::path model_folder() const {
    return options_.model / "point_cloud" / iteration_name(outcome_.iteration);
  }

  std::uint64_t export_model() {
    const auto folder = model_folder();
    make_folder(folder);
    try {
      return backbone_.export_model(folder);
    } catch (...) {
      std::error_code error;
      std::filesystem::remove(folder, error);  // if it is empty: it would hide earlier models
      throw;
    }
  }

  std::map<std::string, double> stage_seconds() const {
    std::map<std::string, double> sums = stages_before_;
    for (const auto& [stage, seconds] : backbone_.stages().seconds()) sums[stage] += seconds;
    return sums;
  }

  std::filesystem::path save() const {
    const auto folder = options_.model / "checkpoints";
    make_folder(folder);
    const Json trainer = {
        {"iteration", outcome_.iteration}, {"seconds", outcome_.seconds}, {"loss", loss_},
        {"identity", identity_},           {"stages", stage_seconds()},   {"curve", curve_to_json(outcome_.curve)}};
    ArchiveWriter archive;
    archive.put(kTrainerEntry, std::string_view(trainer.dump()));
    backbone_.save(archive);
    auto path = folder / (iteration_name(outcome_.iteration) + kCheckpointEnding);
    archive.write(path);
    return path;
  }

  /// The latest checkpoint of this run in the folder options_.resume; empty: none. Others may be of earlier runs.
  std::filesystem::path latest_checkpoint() const {
    std::vector<std::filesystem::path> found;
    for (const auto& entry : std::filesystem::directory_iterator(options_.resume)) {
      if (entry.path().extension() == kCheckpointEnding) found.push_back(entry.path());
    }
    std::ranges::sort(found, [](const auto& a, const auto& b) {
      return in_number_order(b.filename().string(), a.filename().string());
    });
    const auto latest = std::ranges::find_if(found, [&](const std::filesystem::path& path) {
      return read_trainer(ArchiveReader(path), [&](const Json& trainer) {
        return run_difference(trainer.at("identity"), identity_).empty();
      });
    });
    return latest == found.end() ? std::filesystem::path() : *latest;
  }

  /// Calls the body on the state of the trainer in a checkpoint.
  template <class Body>
  static std::invoke_result_t<const Body&, const Json&> read_trainer(const ArchiveReader& archive, const Body& body) {
    try {
      return body(parse_json(archive.text(kTrainerEntry), archive.path().string()));
    } catch (const Json::exception&) {
      throw InputError(archive.path().string() + ": checkpoint is damaged: its trainer entry cannot be read");
    }
  }

  void restore(const std::filesystem::path& checkpoint) {
    ArchiveReader archive(checkpoint);
    read_trainer(archive, [&](const Json& trainer) {
      const std::string difference = run_difference(trainer.at("identity"), identity_);
      if (!difference.empty()) throw InputError(checkpoint.string() + ": made by a run with " + difference);
      outcome_.iteration = trainer.at("iteration").get<int>();
      outcome_.seconds = trainer.at("seconds").get<double>();
      loss_ = trainer.at("loss").get<double>();
      stages_before_ = trainer.at("stages").get<std::map<std::string, double>>();
      outcome_.curve = curve_from_json(trainer.at("curve"));
    });
    backbone_.load(archive);
  }

  Backbone& backbone_;
  const Scene& scene_;
  const TrainOptions& options_;
  Json identity_;
  TrainOutcome outcome_;
  double loss_ = std::nan("");
  std::map<std::string, double> stages_before_;
};

}  // namespace

std::size_t view_of_iteration(int iteration, std::size_t views, std::uint64_t seed) {
  std::vector<std::size_t> order;
  shuffle_epoch(epoch_of(iteration, views), views, seed, order);
  return order[static_cast<std::size_t>(iteration - 1) % views];
}

TrainOutcome train(Backbone& backbone, const Scene& scene, const TrainOptions& options) {
  if (scene.train.empty()) throw InputError("the scene has no training view");
  if (options.iterations < 1) throw InputError("a run needs at least one iteration");
  return Run(backbone, scene, options).train();
}

}  // namespace splatboost

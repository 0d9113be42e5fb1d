// SPDX-License-Identifier: Apache-2.0
/// @file The training loop, the same for every backbone.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "trainer/backbone_api/backbone.h"
#include "trainer/dataset/scene.h"
#include "trainer/evaluation/results.h"

namespace splatboost {

struct TrainOutcome {
  int interrupted_by = 0;            ///< the signal that stopped it, 0: ran to its end; a checkpoint was written
  std::filesystem::path checkpoint;  ///< the one written on interruption
  int iteration = 0;                 ///< last iteration done
  double seconds = 0;                ///< wall time of training, evaluation and saving excluded
  std::vector<CurvePoint> curve;
  std::map<std::string, double> stage_seconds;
  std::uint64_t storage_bytes = 0;  ///< of the final model; 0 if interrupted
};

struct TrainOptions {
  int iterations = kPublishedIterations;
  std::uint64_t seed = 0;
  std::filesystem::path model;       ///< output folder
  std::vector<int> save_iterations;  ///< export the model at these too; the last is always exported
  std::vector<int> checkpoint_iterations;
  /// The first iterations see the scene's train_halves, where it has them.
  int coarse_iterations = 0;
  int curve_points = 20;  ///< how often the curve is sampled with a PSNR (on up to curve_views views)
  int curve_views = 4;
  std::filesystem::path resume;  ///< checkpoint to continue from
  /// Settings that make the run what it is, by the names a user knows them by; flat. A checkpoint of a run that
  /// differs in one of them is refused. Iterations, seed, the views' number and size and the data are added by train().
  nlohmann::json identity = nlohmann::json::object();
  /// Called once a checkpoint, if any, has proved to be good, before anything is written and before the first
  /// iteration; may be empty. What it throws ends train().
  std::function<void(std::size_t primitives)> on_start;
  /// Called after the last iteration, before the model is exported, with all but its size; may be empty. What it writes
  /// down is there whenever the model is, also after a kill.
  std::function<void(const TrainOutcome&)> on_end;
  std::string label;  ///< shown in the progress line
  bool quiet = false;
};

/// Which training view an iteration sees: a fresh random permutation every epoch, a pure function of the arguments.
std::size_t view_of_iteration(int iteration, std::size_t views, std::uint64_t seed);

/// Trains until done or interrupted. The first SIGINT, SIGTERM, SIGHUP (the terminal was closed) or SIGPIPE (nobody
/// reads the progress any more) lets the iteration end and writes checkpoints/iteration_N.ckpt; the second ends the
/// process at once, except that a second SIGPIPE is ignored. While training runs, those signals are its own.
///
/// Exports to point_cloud/iteration_N. Backbone::finish() is called after the last iteration only, so that models saved
/// on the way do not change the run. Throws std::runtime_error naming the iteration if the loss is not finite, and
/// InputError if options.resume is not a checkpoint of this run. Where the memory of a GPU does not do, the model so
/// far is exported, and DeviceMemoryError says where it is.
TrainOutcome train(Backbone& backbone, const Scene& scene, const TrainOptions& options);

}  // namespace splatboost

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
  int interrupted_by = 0;            ///< signal that came during the run; 0: none
  std::filesystem::path checkpoint;  ///< the checkpoint then written; empty: the run has ended and exported its model
  int iteration = 0;                 ///< last completed iteration
  double seconds = 0;                ///< wall time of training, evaluation and saving excluded
  std::vector<CurvePoint> curve;
  std::map<std::string, double> stage_seconds;
  std::uint64_t storage_bytes = 0;  ///< of the final model; 0 if a signal stopped the run before
  std::string unsaved;  ///< why the first early model or checkpoint could not be written; empty: none failed
};

struct TrainOptions {
  int iterations = kPublishedIterations;
  std::uint64_t seed = 0;
  std::filesystem::path model;       ///< output folder
  std::vector<int> save_iterations;  ///< export the model after these, too; the last is always exported
  std::vector<int> checkpoint_iterations;
  /// Number of first iterations that train on the scene's train_halves, if it has them.
  int coarse_iterations = 0;
  int curve_points = 20;  ///< samples of the curve, each with a PSNR over up to curve_views views
  int curve_views = 4;
  /// Checkpoint to continue from; or a folder of checkpoints: the latest of this run in it, if there is one.
  std::filesystem::path resume;
  /// Settings that define the run, by the names that users know; a flat object. A checkpoint of a run that differs in
  /// one of them is refused. train() adds iterations, seed, the number and size of the views, and the data.
  nlohmann::json identity = nlohmann::json::object();
  /// Called after the checkpoint, if any, was loaded and validated, before anything is written and before the first
  /// iteration; may be empty. An exception from it ends train().
  std::function<void(std::size_t primitives)> on_start;
  /// Called after the last iteration and before the model is exported, with everything but the model size; may be
  /// empty. So what it writes exists whenever the final model does, even if the process is killed.
  std::function<void(const TrainOutcome&)> on_end;
  std::string label;  ///< shown in the progress line
  bool quiet = false;
};

/// Index of the training view of an iteration: a new random permutation every epoch, a pure function of the arguments.
std::size_t view_of_iteration(int iteration, std::size_t views, std::uint64_t seed);

/// Trains until done or interrupted. On the first SIGINT, SIGTERM, SIGHUP (the terminal was closed) or SIGPIPE (the
/// reader of the progress has exited), completes the iteration and writes checkpoints/iteration_N.ckpt; the second ends
/// the process at once, except that a second SIGPIPE is ignored. train() owns the handlers of these signals while it
/// runs.
///
/// After the last iteration, a signal stops nothing: the model is exported, and the signal is returned.
///
/// Exports to point_cloud/iteration_N. Backbone::finish() is called after the last iteration only, so that intermediate
/// exports do not change the run. An early model or a checkpoint that cannot be written is told in a warning, and
/// training goes on; at a signal, the model so far is exported instead, and std::runtime_error gives its path.
///
/// Throws std::runtime_error naming the iteration if the loss is not finite, and InputError if options.resume is not a
/// checkpoint of this run. If GPU memory runs out, exports the model so far and throws DeviceMemoryError with its path.
TrainOutcome train(Backbone& backbone, const Scene& scene, const TrainOptions& options);

}  // namespace splatboost

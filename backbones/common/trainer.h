// SPDX-License-Identifier: Apache-2.0
/// @file The training loop and the evaluation, the same for every backbone.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/backbone.h"
#include "common/metrics.h"
#include "common/results.h"
#include "common/scene.h"

namespace splatboost {

struct TrainOptions {
  int iterations = kPublishedIterations;
  std::uint64_t seed = 0;
  std::filesystem::path model;         ///< output folder
  std::vector<int> save_iterations;    ///< export the model at these too; the last is always exported
  std::vector<int> checkpoint_iterations;
  int curve_points = 20;               ///< how often the curve is sampled with a PSNR (on up to curve_views views)
  int curve_views = 4;
  std::filesystem::path resume;        ///< checkpoint to continue from
  std::string label;                   ///< shown in the progress line
  bool quiet = false;
};

struct TrainOutcome {
  bool interrupted = false;            ///< by Ctrl-C; a checkpoint was written
  std::filesystem::path checkpoint;    ///< the one written on interruption
  int iteration = 0;                   ///< last iteration done
  double seconds = 0;                  ///< wall time of training, evaluation and saving excluded
  std::vector<CurvePoint> curve;
};

/// Which training view an iteration sees: a fresh random permutation every epoch, a pure function of the arguments.
std::size_t view_of_iteration(int iteration, std::size_t views, std::uint64_t seed);

/// Trains until done or interrupted (SIGINT, SIGTERM).
TrainOutcome train(Backbone& backbone, const Scene& scene, const TrainOptions& options);

/// Renders the test views (training views if there are none) into `renders` as PNG, measures them, and fills the
/// quality part of `results` (psnr, ssim, lpips, psnr_beta1, split, views, fps).
void evaluate(Backbone& backbone, const Scene& scene, Lpips* lpips, const std::filesystem::path& renders,
              Results& results);

/// Saves a planar [3,H,W] float image as PNG, clamped to [0,1]. Atomic.
void write_png(const std::filesystem::path& path, std::span<const float> color, int width, int height);

}  // namespace splatboost

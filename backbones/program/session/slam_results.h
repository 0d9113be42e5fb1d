// SPDX-License-Identifier: Apache-2.0
/// @file What a run of `splatboost slam` leaves: trajectories, keyframes, pictures, results.json, the report.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "program/session/slam_run.h"
#include "trainer/evaluation/metrics.h"
#include "trainer/evaluation/results.h"
#include "trainer/report/report.h"

namespace splatboost::program {

/// How far the tracked positions are from those of the dataset.
struct TrajectoryError {
  double ate_rmse = 0;     ///< metres, after the rigid motion that fits best
  double path = 0;         ///< length of the true path, metres
  std::size_t frames = 0;  ///< that both have
  glm::dmat4 truth_from_map{1.0};
};

/// None: the dataset has no truth, or less than three tracked frames have one.
std::optional<TrajectoryError> trajectory_error(const SlamRun& run, const SlamOutcome& outcome,
                                                const Sequence& sequence);

/// camera_from_world of a tracked frame, on the map as it is in the end.
glm::dmat4 pose_of(const SlamRun& run, const TrackedFrame& frame);

/// trajectory.txt of all tracked frames and keyframes.txt, both in TUM's form, and keyframes/, a COLMAP scene that
/// `train`, `render` and `eval` read.
void write_tracking(const SlamRun& run, const SlamOutcome& outcome, Sequence& sequence,
                    const std::filesystem::path& folder);

/// Renders and measures every tracked frame; fills the quality part of `results` with the means over all of them.
/// Pictures of some go to folder/test. Once `stopped` says so, the rest of the frames is left out.
/// @return of the keyframes alone, for results.json
nlohmann::json measure_frames(SlamRun& run, const SlamOutcome& outcome, Sequence& sequence, int resolution,
                              Lpips* lpips, const std::filesystem::path& folder, const std::function<bool()>& stopped,
                              Results& results, std::vector<ReportView>& views);

/// The paths as the report draws them, along the axis of the least motion.
std::vector<ReportTrack> report_tracks(const SlamRun& run, const SlamOutcome& outcome, const Sequence& sequence,
                                       const std::optional<TrajectoryError>& error);

}  // namespace splatboost::program

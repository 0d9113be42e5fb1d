// SPDX-License-Identifier: Apache-2.0
/// @file Output of a run of `splatboost slam`: trajectories, keyframes, pictures, results.json, the report.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "program/slam/slam_run.h"
#include "trainer/evaluation/metrics.h"
#include "trainer/evaluation/results.h"
#include "trainer/report/report.h"

namespace splatboost::program {

/// Deviation of the tracked positions from the ground truth of the dataset.
struct TrajectoryError {
  double ate_rmse = 0;             ///< metres, after rigid alignment, or after alignment with scale if the map has none
  double scale = 1;                ///< metres per unit of length of the map, if that is not metric
  double path = 0;                 ///< length of the true path, metres
  std::size_t frames = 0;          ///< number of frames with both positions
  glm::dmat4 truth_from_map{1.0};  ///< similarity
};

/// None: the dataset has no ground truth, or fewer than three tracked frames have one.
std::optional<TrajectoryError> trajectory_error(const SlamRun& run, const SlamOutcome& outcome,
                                                const Sequence& sequence);

/// camera_from_world of a tracked frame in the final map.
glm::dmat4 pose_of(const SlamRun& run, const TrackedFrame& frame);

/// Writes trajectory.txt (all tracked frames) and keyframes.txt, both in TUM format, and keyframes/, a COLMAP scene
/// that `train`, `render` and `eval` read.
void write_tracking(const SlamRun& run, const SlamOutcome& outcome, Sequence& sequence,
                    const std::filesystem::path& folder);

/// Renders and measures every tracked frame; fills the quality part of `results` with the means over all of them, or,
/// with a warning, over those that can still be read. Writes pictures of some frames to folder/test. Stops when
/// `stopped` returns true; the means are then NaN.
/// @return the means over the keyframes alone, for results.json
nlohmann::json measure_frames(SlamRun& run, const SlamOutcome& outcome, Sequence& sequence, int resolution,
                              Lpips* lpips, const std::filesystem::path& folder, const std::function<bool()>& stopped,
                              Results& results, std::vector<ReportView>& views);

/// The camera paths for the report, projected along the axis of least motion.
std::vector<ReportTrack> report_tracks(const SlamRun& run, const SlamOutcome& outcome, const Sequence& sequence,
                                       const std::optional<TrajectoryError>& error);

/// Measures the model on the keyframes alone, and writes their pictures, for a run that has not measured its tracked
/// frames. Pictures of those that were left in folder/test are removed.
std::vector<ReportView> measure_keyframes(Backbone& backbone, const Scene& keyframes, Lpips* lpips,
                                          const std::filesystem::path& folder, Results& results);

/// What was tracked, in lines for the terminal and the report. @param results contents of results.json
std::vector<std::string> tracking_lines(const nlohmann::json& results);

/// Writes report.html. @param label of the run @param json contents of results.json
/// @param tracks without any, those of the page that is replaced are kept
void write_slam_report(const std::filesystem::path& folder, const std::string& label, const Results& results,
                       const nlohmann::json& json, const std::vector<ReportView>& views,
                       const std::vector<ReportTrack>& tracks = {});

}  // namespace splatboost::program

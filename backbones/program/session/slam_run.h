// SPDX-License-Identifier: Apache-2.0
/// @file Mapping while a camera moves: a tracker finds its poses, and an online backbone trains on its keyframes.
#pragma once

#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "families/tracking/tracker.h"
#include "program/session/options.h"
#include "program/session/plugged_backbone.h"
#include "trainer/backbone_api/online_backbone.h"
#include "trainer/dataset/scene.h"
#include "trainer/evaluation/results.h"
#include "trainer/sequence/sequence.h"

namespace splatboost::program {

struct SlamOptions {
  SequenceOptions sequence;
  TrackerOptions tracker;
  int initial_keyframes = 10;     ///< mapping begins with so many, or with what the whole sequence has
  std::optional<int> lockstep;    ///< iterations a keyframe, in a fixed order; none: tracking and mapping run at once
  std::optional<double> seconds;  ///< mapping ends when the sequence has and so many have passed
};

/// The picture as it is mapped: at its size, with a pose.
View view_of(const SequenceFrame& frame, const Calibration& calibration, int resolution,
             const glm::dmat4& camera_from_world);

struct SlamOutcome {
  std::vector<TrackedFrame> frames;  ///< of the whole sequence
  std::vector<std::size_t> keyframe_frames;
  int iterations = 0;              ///< of the mapper
  int iterations_in_sequence = 0;  ///< of these, before its end
  double sequence_seconds = 0;     ///< wall time from the first to the last frame
  double tracking_seconds = 0;     ///< of these, reading and tracking frames
  double mapping_seconds = 0;      ///< from the first frame to the last iteration
  std::vector<CurvePoint> curve;
  std::map<std::string, double> stage_seconds;
  bool complete = true;        ///< false: it was stopped, or failed, before its end
  std::exception_ptr failure;  ///< why it failed, null: it did not
};

/// A run. What it makes of the scene and the backbone is there afterwards.
class SlamRun {
 public:
  /// @param make_backbone called once, when there are enough keyframes, with the scene to train on; its backbone is an
  /// OnlineBackbone
  /// @param stopped asked by both threads after every frame and iteration: whether the run is to end now
  SlamRun(Sequence& sequence, const SlamOptions& slam, const RunOptions& options,
          std::function<PluggedBackbone(const Scene&)> make_backbone, std::function<bool()> stopped);

  /// Throws InputError where nothing could be tracked or a setting is wrong. Where the run is stopped or fails once
  /// there is a keyframe, it returns with all there is of trajectory, keyframes and model; stopped before, without any.
  SlamOutcome run();

  const Scene& scene() const { return scene_; }
  Backbone& backbone() { return *plugged_.backbone; }
  const PluggedBackbone& plugged() const { return plugged_; }
  const Tracker& tracker() const { return tracker_; }

 private:
  /// What the tracker tells the mapper.
  struct Update {
    std::vector<View> views;        ///< new keyframes
    std::vector<glm::dmat4> poses;  ///< camera_from_world of all keyframes
    MapChange change;
  };

  /// Tracks one frame. @return what is new on the map, if anything is
  std::optional<Update> track(std::size_t number);
  /// Once it has thrown the map is a change behind the tracker, and no later change fits to it.
  void take(Update update);
  void add_to_map(Update update);
  void take_waiting();
  void begin_mapping();
  void iterate();
  void follow_sequence();
  void keep_what_there_is();
  void run_in_lockstep();
  void run_at_once();
  void finish_mapping();
  void check_focal_lengths() const;
  void tell(const TrackedFrame& frame, const SequenceFrame& picture);
  void show_progress(bool last);
  double seconds() const;

  Sequence& sequence_;
  SlamOptions slam_;
  const RunOptions& options_;
  std::function<PluggedBackbone(const Scene&)> make_backbone_;
  std::function<bool()> stopped_;
  Tracker tracker_;
  std::mutex waiting_mutex_;
  std::deque<Update> waiting_;  ///< from the tracking thread to the mapper's
  bool take_failed_ = false;
  Scene scene_;
  SeenPoints first_points_;  ///< before there is a backbone
  PluggedBackbone plugged_;
  OnlineBackbone* online_ = nullptr;
  SlamOutcome outcome_;
  int iteration_ = 0;
  double loss_ = 0;
  double began_ = 0, shown_ = 0;
  TrackState last_state_ = TrackState::waiting;
  std::size_t tracked_ = 0, problems_ = 0;
};

}  // namespace splatboost::program

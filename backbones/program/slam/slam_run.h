// SPDX-License-Identifier: Apache-2.0
/// @file Mapping while a camera moves: a tracker estimates its poses, and an online backbone trains on its keyframes.
#pragma once

#include <atomic>
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
#include "program/session/plugged_backbone.h"
#include "program/session/run_options.h"
#include "trainer/backbone_api/online_backbone.h"
#include "trainer/dataset/scene.h"
#include "trainer/evaluation/results.h"
#include "trainer/sequence/sequence.h"

namespace splatboost::program {

struct SlamOptions {
  SequenceOptions sequence;
  TrackerOptions tracker;
  int initial_keyframes = 10;     ///< mapping begins with this many, or with fewer if the sequence ends before
  std::optional<int> lockstep;    ///< iterations per keyframe, in a fixed order; none: tracking and mapping in parallel
  std::optional<double> seconds;  ///< mapping ends when the sequence has ended and this time has passed
  bool keep_untrained = true;     ///< a run that ends before its mapping begins still makes a model of its keyframes
};

/// The frame as a view to map: resized, and with a pose.
View view_of(const SequenceFrame& frame, const Calibration& calibration, int resolution,
             const glm::dmat4& camera_from_world);

struct SlamOutcome {
  std::vector<TrackedFrame> frames;  ///< all frames of the sequence
  std::vector<std::size_t> keyframe_frames;
  int iterations = 0;              ///< iterations of the mapper
  int iterations_in_sequence = 0;  ///< of these, before the end of the sequence
  double sequence_seconds = 0;     ///< wall time from the first to the last frame
  double tracking_seconds = 0;     ///< of these, for reading and tracking frames
  double mapping_seconds = 0;      ///< from the first frame to the last iteration
  std::vector<CurvePoint> curve;
  std::map<std::string, double> stage_seconds;
  bool complete = true;        ///< false: it was stopped, or failed, before its end
  std::exception_ptr failure;  ///< null: it did not fail
};

/// A run. Its scene and its backbone remain available afterwards.
class SlamRun {
 public:
  /// @param make_backbone called once, when there are enough keyframes, with the scene to train on; must return an
  /// OnlineBackbone
  /// @param stopped called by both threads after every frame and iteration; true ends the run
  SlamRun(Sequence& sequence, const SlamOptions& slam, const RunOptions& options,
          std::function<PluggedBackbone(const Scene&)> make_backbone, std::function<bool()> stopped);

  /// Throws InputError if nothing could be tracked or a setting is wrong. If the run is stopped or fails after the
  /// first keyframe, returns the trajectory, the keyframes and the model so far; if it is stopped before that, without
  /// them. See also SlamOptions::keep_untrained.
  SlamOutcome run();

  const Scene& scene() const { return scene_; }
  /// Whether there is a model. Only then backbone() and plugged() may be called.
  bool has_model() const { return online_ != nullptr; }
  Backbone& backbone() { return *plugged_.backbone; }
  const PluggedBackbone& plugged() const { return plugged_; }
  const Tracker& tracker() const { return tracker_; }

 private:
  /// A message from the tracker to the mapper.
  struct Update {
    std::vector<View> views;        ///< new keyframes
    std::vector<glm::dmat4> poses;  ///< camera_from_world of all keyframes
    MapChange change;
  };

  /// Tracks one frame. @return the change of the map, if any; changes of a map on trial are held back
  std::optional<Update> track(std::size_t number);
  /// All that the mapper does not have yet.
  Update next_update();
  /// After the last frame: takes what is held back.
  void take_held();
  /// The tracker has dropped its map.
  void forget_map();
  /// If this throws, the map lacks one change of the tracker, and no later change can be applied.
  void take(Update update);
  void add_to_map(Update update);
  void take_waiting();
  /// Whether the run goes on, or makes a model even if it ends now.
  bool may_begin_mapping() const;
  void begin_mapping();
  void iterate();
  /// Adds a point to the curves, unless nothing was trained since the last one.
  void sample_curve();
  void follow_sequence();
  void keep_what_there_is();
  void run_in_lockstep();
  void run_at_once();
  void finish_mapping();
  void check_focal_lengths() const;
  /// Why there is no keyframe after the last frame, as part of a line.
  std::string why_nothing_was_tracked() const;
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
  std::deque<Update> waiting_;  ///< from the tracking thread to the mapping thread
  bool take_failed_ = false;
  std::vector<View> held_;  ///< keyframes that are not in an Update yet
  Scene scene_;
  SeenPoints first_points_;  ///< collected until there is a backbone
  PluggedBackbone plugged_;
  OnlineBackbone* online_ = nullptr;
  SlamOutcome outcome_;
  int iteration_ = 0;
  double loss_ = 0;
  /// Copies for show_progress(), which the tracking thread calls while the mapper runs.
  struct {
    std::atomic<int> iteration = 0;
    std::atomic<double> loss = 0;
    std::atomic<std::size_t> primitives = 0;
  } shown_mapping_;
  double began_ = 0, shown_ = 0;
  TrackState last_state_ = TrackState::waiting;
  std::size_t tracked_ = 0, problems_ = 0, unusable_ = 0;  ///< unusable: frames without an image
};

}  // namespace splatboost::program

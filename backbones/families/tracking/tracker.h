// SPDX-License-Identifier: Apache-2.0
/// @file Where a camera with depth is, frame by frame, and a sparse map of what it saw (RGB-D SLAM after ORB-SLAM's
/// papers: Mur-Artal et al. 2015, 2017). Features, matching and PnP are OpenCV's, least squares Ceres's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glm/mat4x4.hpp>

#include "trainer/backbone_api/online_backbone.h"
#include "trainer/sequence/sequence.h"

namespace splatboost {

struct TrackerOptions {
  int features = 1000;         ///< a frame
  double nearest_depth = 0.1;  ///< metres; depth outside of these is not used
  double farthest_depth = 10;
  double keyframe_shift = 0.03;  ///< a keyframe comes after so much motion, × median depth,
  double keyframe_turn = 4;      ///< so many degrees,
  int keyframe_gap = 10;         ///< so many frames,
  double keyframe_share = 0.4;   ///< or when less than this share of the last one's points is still seen; but not
                                 ///< within that motion of an earlier keyframe that sees the same points
  bool loops = true;             ///< whether loops are looked for
};

enum class TrackState {
  waiting,  ///< there is no map yet: no frame had enough features with depth
  tracked,
  lost,
  dropped,  ///< the picture cannot be used
};

struct TrackedFrame {
  std::size_t frame = 0;  ///< SequenceFrame::number
  TrackState state = TrackState::waiting;
  std::size_t keyframe = 0;              ///< that the pose is relative to, so that it moves with the map
  glm::dmat4 camera_from_keyframe{1.0};  ///< of tracked frames
  std::size_t matches = 0;               ///< points of the map that fit
  bool is_keyframe = false;
  bool closed_loop = false;
  bool relocalized = false;
};

/// One thread at a time. Same frames, same poses.
class Tracker {
 public:
  /// Throws InputError in a build without OpenCV or Ceres.
  Tracker(const Calibration& calibration, const TrackerOptions& options);
  ~Tracker();

  TrackedFrame track(const SequenceFrame& frame);

  std::size_t keyframes() const;
  /// Of a keyframe as it is now.
  glm::dmat4 camera_from_world(std::size_t keyframe) const;
  /// SequenceFrame::number of a keyframe.
  std::size_t frame_of(std::size_t keyframe) const;
  std::size_t map_points() const;
  /// The whole map, for a model of it.
  PointCloud cloud() const;
  int loops() const;
  /// What the focal lengths should be multiplied by, where pictures and depth clearly say that they are wrong.
  std::optional<double> better_focal_factor() const;
  /// What has come since the last call. The keyframes are its views.
  MapChange take_change();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Whether this build can track.
bool have_tracking();

}  // namespace splatboost

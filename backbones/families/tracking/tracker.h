// SPDX-License-Identifier: Apache-2.0
/// @file Tracking of an RGB-D camera, or of one camera without depth, with a sparse map (after the papers on ORB-SLAM:
/// Mur-Artal et al. 2015, 2017). Uses OpenCV for features, matching, PnP and the essential matrix, and Ceres for least
/// squares.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glm/mat4x4.hpp>

#include "trainer/backbone_api/online_backbone.h"
#include "trainer/sequence/sequence.h"

namespace splatboost {

struct TrackerOptions {
  int features = 1000;         ///< per frame
  double nearest_depth = 0.1;  ///< metres; depth outside this range is ignored
  double farthest_depth = 10;
  double keyframe_shift = 0.03;  ///< a keyframe is added after this motion, × median depth,
  double keyframe_turn = 4;      ///< this rotation, degrees,
  int keyframe_gap = 10;         ///< this number of frames,
  double keyframe_share = 0.4;   ///< or if matches fall below this share of the last keyframe's points; but not
                                 ///< within that motion of an earlier keyframe that sees the same points
  bool loops = true;             ///< whether to detect and close loops
};

/// Minimum number of features with depth, or of matches without depth, for a map to begin.
inline constexpr std::size_t kFeaturesToBegin = 50;

/// What frames lacked to begin a map with, in numbers of frames. Each counts once, by the first reason that applies.
struct LackOfMap {
  std::size_t few_features = 0;  ///< the image has fewer than kFeaturesToBegin features
  std::size_t no_parallax = 0;   ///< without depth: not enough of them were seen from a different place
  std::size_t no_depth = 0;      ///< SequenceFrame::depth is empty
  std::size_t few_depths = 0;    ///< fewer than kFeaturesToBegin features have depth
  std::size_t too_near = 0;      ///< that many have, but most others are below TrackerOptions::nearest_depth
  std::size_t too_far = 0;       ///< … or beyond TrackerOptions::farthest_depth
  std::size_t most_features = 0, most_depths = 0;  ///< in one frame
  /// Range of the depths of features, metres; not limited by TrackerOptions.
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
};

enum class TrackState {
  waiting,  ///< no map yet: no frame had enough features with depth or, without depth, no two enough parallax
  tracked,
  lost,
  dropped,  ///< the image is unusable
};

struct TrackedFrame {
  std::size_t frame = 0;  ///< SequenceFrame::number
  TrackState state = TrackState::waiting;
  std::size_t keyframe = 0;              ///< the pose is relative to it, so it follows corrections of the map
  glm::dmat4 camera_from_keyframe{1.0};  ///< valid for tracked frames
  double scale = 1;                      ///< of the keyframe at that time; changes if loops change the unit of length
  std::size_t matches = 0;               ///< number of inlier map points
  bool is_keyframe = false;
  bool closed_loop = false;
  bool relocalized = false;
  bool begins_anew = false;  ///< the map was dropped before this frame: earlier frames have no pose any more
};

/// Without depth (Calibration::depth_scale is 0) the map begins with two frames that see the same points from different
/// places: track() then adds two keyframes at once, the first of an earlier frame. The unit of length is the median
/// depth of the points in it. Two views can agree on a wrong map, in which later frames cannot be located. So the map
/// is on trial until it has a few keyframes: if tracking is lost for several frames before, it is dropped, and another
/// one begins.
///
/// Not thread-safe. Deterministic: the same frames give the same poses.
class Tracker {
 public:
  /// Throws InputError in a build without OpenCV or Ceres.
  Tracker(const Calibration& calibration, const TrackerOptions& options);
  ~Tracker();

  TrackedFrame track(const SequenceFrame& frame);

  std::size_t keyframes() const;
  /// Whether the map, if there is one, may still be dropped; never with depth.
  bool on_trial() const;
  /// Current pose of a keyframe.
  glm::dmat4 camera_from_world(std::size_t keyframe) const;
  /// Current pose of a tracked frame.
  glm::dmat4 camera_from_world(const TrackedFrame& frame) const;
  /// SequenceFrame::number of a keyframe.
  std::size_t frame_of(std::size_t keyframe) const;
  std::size_t map_points() const;
  /// Of all frames that came while there was no map, without those whose image is unusable.
  const LackOfMap& lack_of_map() const;
  /// All map points, to initialise a model.
  PointCloud cloud() const;
  int loops() const;
  /// Factor to correct the focal lengths if images and depth clearly contradict them, see focal_check.h.
  std::optional<double> better_focal_factor() const;
  /// Changes since the last call. The views of MapChange are the keyframes.
  MapChange take_change();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Whether this build has tracking.
bool have_tracking();

}  // namespace splatboost

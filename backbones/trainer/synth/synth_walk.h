// SPDX-License-Identifier: Apache-2.0
/// @file A walk through the room with an RGB-D camera or a stereo pair, as a sequence for SLAM.
#pragma once

#include "trainer/synth/synth.h"
#include "trainer/synth/synth_world.h"

namespace splatboost {

/// Default number of frames of a walk: once around the room, ending past the start.
inline constexpr int kWalkFrames = 300;

/// Pose of the camera at frame `index` of `count`.
synthetic::Pose walk_pose(int index, int count);

/// Standard deviation, in metres, of a depth measurement at `z` metres (Kinect; Nguyen et al. 2012).
double depth_sigma(double z);

/// Writes the sequence in Replica's layout: results/frame*.png, results/depth*.png, traj.txt, cam_params.json. Depth
/// has the noise of a sensor, and is missing (0) at edges, at grazing angles and outside of 0.3 to 8 m.
void write_walk(const SynthOptions& options);

/// Writes the same walk with two cameras, options.baseline apart, in EuRoC's layout: mav0/cam0, mav0/cam1 and the
/// true poses of the body in mav0/state_groundtruth_estimate0.
void write_stereo_walk(const SynthOptions& options);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file A walk through the room with a camera of colour and depth, as a sequence for SLAM.
#pragma once

#include "trainer/synth/synth.h"
#include "trainer/synth/synth_world.h"

namespace splatboost {

/// Frames of a walk: once around, and on over its beginning.
inline constexpr int kWalkFrames = 300;

/// Where the camera is at frame `index`.
synthetic::Pose walk_pose(int index, int count);

/// Standard deviation of a depth camera's measurement at `z` metres (Nguyen et al. 2012, of the Kinect).
double depth_sigma(double z);

/// Writes the sequence in Replica's layout: results/frame*.png, results/depth*.png, traj.txt, cam_params.json. Depth
/// has the noise of a sensor, and none at edges, at grazing angles and beyond 8 m.
void write_walk(const SynthOptions& options);

/// Writes the same walk with two cameras, options.baseline apart, in EuRoC's layout: mav0/cam0, mav0/cam1 and the
/// true poses of the body in mav0/state_groundtruth_estimate0.
void write_stereo_walk(const SynthOptions& options);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file The first frames of the synthetic walk, with exact depth, for tests of trackers and mappers.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "splatboost/threads.h"
#include "trainer/sequence/sequence.h"
#include "trainer/synth/synth_view.h"
#include "trainer/synth/synth_walk.h"

namespace splatboost::testing {

/// Frames 0 … count − 1 of a walk of `whole` frames. Ray tracing takes most of a test's time, so make them once.
/// @param turns_only whether the camera stays where the walk begins and only turns
inline std::vector<SequenceFrame> walk_frames(int width, int height, int count, int whole, bool turns_only = false) {
  const auto world = synthetic::make_room();
  const synthetic::Intrinsics camera(width, height);
  Threads threads;
  std::vector<SequenceFrame> made;
  for (int i = 0; i < count; ++i) {
    synthetic::Picture picture(camera);
    synthetic::Pose pose = walk_pose(i, whole);
    if (turns_only) pose.centre = walk_pose(0, whole).centre;
    synthetic::render_view(*world, camera, pose, 1, threads, picture);
    SequenceFrame frame;
    frame.number = static_cast<std::size_t>(i);
    frame.name = std::to_string(i) + ".png";
    frame.width = width;
    frame.height = height;
    frame.color = picture.color;
    frame.depth.assign(picture.depth.begin(), picture.depth.end());
    made.push_back(std::move(frame));
  }
  return made;
}

}  // namespace splatboost::testing

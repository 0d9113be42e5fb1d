// SPDX-License-Identifier: Apache-2.0
/// @file A picture of a world: colour, depth, normals and what is an object.
#pragma once

#include <cstdint>
#include <vector>

#include "splatboost/threads.h"
#include "trainer/synth/synth_world.h"

namespace splatboost::synthetic {

/// Pixel centres are at (i + 0.5, j + 0.5).
struct Intrinsics {
  int width, height;
  double focal, cx, cy;

  /// The camera of all scenes: 66 degrees across.
  static Intrinsics of(int width, int height);
  Ray ray(const Pose& pose, double x, double y) const {
    return {pose.centre, glm::normalize(pose.world_from_camera * Vec3((x - cx) / focal, (y - cy) / focal, 1.0))};
  }
};

struct Picture {
  std::vector<std::uint8_t> color;    ///< RGB
  std::vector<double> depth;          ///< z in metres, 0 in the sky
  std::vector<std::uint8_t> normals;  ///< RGB, world, 127.5·(n + 1)
  std::vector<std::uint8_t> mask;     ///< 255 for objects
};

/// @param samples per pixel and axis
void take_picture(const World& world, const Intrinsics& camera, const Pose& pose, int samples, Threads& threads,
                  Picture& picture);

}  // namespace splatboost::synthetic

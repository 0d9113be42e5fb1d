// SPDX-License-Identifier: Apache-2.0
/// @file Ray-traced scenes with exact ground truth, so that everything can be tried without a download.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace splatboost {

struct SynthOptions {
  std::filesystem::path output;
  /// "room"; "object": its podium and what stands on it, in front of a backdrop; "street": 64 m of houses, seen from
  /// the pavement, from close by and from above; "moving": the room with objects that fly, swing and bend; "walk": a
  /// sequence of the room for SLAM, with depth (synth_walk.h); it ignores points and point_noise.
  std::string scene = "room";
  int width = 320;
  int height = 240;
  int views = 48;             ///< number of images; for "moving", of training images
  int cameras = 0;            ///< "moving": cameras of a static rig, fewer than views; 0: one camera that walks around
  double baseline = 0;        ///< "walk": metres between two cameras, which replace depth; 0: one camera with depth
  int backdrop = 0;           ///< "object": grey value, 0 to 255
  int points = 4000;          ///< in the sparse cloud
  float point_noise = 0.01f;  ///< standard deviation of the points, world units (metres)
  int samples = 2;            ///< per pixel and axis, for antialiasing
  int surface_points = 0;     ///< exact points sampled on the surfaces in the views, in surface.ply; 0: no such file
  std::uint64_t seed = 0;
};

/// Writes a COLMAP scene: images/*.png, sparse/0/*.bin, and ground truth in depth/*.png (16 bit, millimetres along z),
/// normals/*.png (world frame, 127.5·(n + 1)) and masks/*.png (objects white; room, ground and sky black). Depth is 0
/// in the sky and beyond 65 m. surface.ply is written on request. The scene "moving" has times and D-NeRF's layout:
/// transforms_train.json and transforms_test.json, train/*.png and test/*.png, points3d.ply, and ground truth in the
/// subfolders train/ and test/ of depth/, normals/ and masks/; motion/ holds where the points of points3d.ply are,
/// without noise, at 21 times from 0 to 1. Its test views are combinations of pose and time that training does not see.
/// The same options always give the same bytes. A scene that was written into the folder before is removed; synth.json,
/// with the options, identifies it. Throws InputError on impossible options and if the folder holds other files.
void write_synthetic_scene(const SynthOptions& options);

}  // namespace splatboost

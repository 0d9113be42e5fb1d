// SPDX-License-Identifier: Apache-2.0
/// @file Ray-traced scenes with exact truth, so that everything here can be tried without a download.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace splatboost {

struct SynthOptions {
  std::filesystem::path output;
  /// Or "street": 64 m of houses, seen from the pavement, from close by and from above; or "moving": the room with
  /// things that fly, swing and bend; or "walk": a sequence of the room for SLAM, with depth (synth_walk.h), for which
  /// points and point_noise mean nothing.
  std::string scene = "room";
  int width = 320;
  int height = 240;
  int views = 48;             ///< cameras, all COLMAP images; of "moving" those to train on
  int cameras = 0;            ///< of "moving": of a rig that films from still places; 0: one camera, which walks around
  double baseline = 0;        ///< of "walk": metres between two cameras, which then take the place of depth; 0: one
  int points = 4000;          ///< of the sparse cloud
  float point_noise = 0.01f;  ///< standard deviation of the points, world units (metres)
  int samples = 2;            ///< per pixel and axis, for antialiasing
  int surface_points = 0;     ///< exact points of what the views see, in surface.ply; 0: no such file
  std::uint64_t seed = 0;
};

/// Writes a COLMAP scene: images/*.png, sparse/0/*.bin, and beside it depth/*.png (16 bit, millimetres of z),
/// normals/*.png (world frame, 127.5·(n + 1)), masks/*.png (objects white, room, ground and sky black). Depth is 0 in
/// the sky and beyond 65 m. surface.ply, if asked for. The scene "moving" has times: it is written as D-NeRF's are,
/// transforms_train.json and transforms_test.json, with train/*.png and test/*.png, points3d.ply, and the same folders
/// of truth below depth/, normals/ and masks/; the test views are of pairs of a place and a time that training does not
/// see. Same options, same bytes. Throws InputError on impossible options.
void write_synthetic_scene(const SynthOptions& options);

}  // namespace splatboost

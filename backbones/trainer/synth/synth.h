// SPDX-License-Identifier: Apache-2.0
/// @file Ray-traced scenes with exact truth, so that everything here can be tried without a download.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace splatboost {

struct SynthOptions {
  std::filesystem::path output;
  std::string scene = "room";  ///< or "street": 64 m of houses, seen from the pavement, from close by and from above
  int width = 320;
  int height = 240;
  int views = 48;             ///< cameras, all COLMAP images
  int points = 4000;          ///< of the sparse cloud
  float point_noise = 0.01f;  ///< standard deviation of the points, world units (metres)
  int samples = 2;            ///< per pixel and axis, for antialiasing
  int surface_points = 0;     ///< exact points of what the views see, in surface.ply; 0: no such file
  std::uint64_t seed = 0;
};

/// Writes a COLMAP scene: images/*.png, sparse/0/*.bin, and beside it depth/*.png (16 bit, millimetres of z),
/// normals/*.png (world frame, 127.5·(n + 1)), masks/*.png (objects white, room, ground and sky black). Depth is 0 in
/// the sky and beyond 65 m. surface.ply, if asked for. Same options, same bytes. Throws InputError on impossible
/// options.
void write_synthetic_scene(const SynthOptions& options);

}  // namespace splatboost

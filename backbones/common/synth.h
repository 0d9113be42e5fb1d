// SPDX-License-Identifier: Apache-2.0
/// @file Ray-traced scenes with exact truth, so that everything here can be tried without a download.
#pragma once

#include <cstdint>
#include <filesystem>

namespace splatboost {

struct SynthOptions {
  std::filesystem::path output;
  int width = 320;
  int height = 240;
  int views = 48;             ///< cameras, all COLMAP images
  int points = 4000;          ///< of the sparse cloud
  float point_noise = 0.01f;  ///< standard deviation of the points, world units (the room is a few units wide)
  int samples = 2;            ///< per pixel and axis, for antialiasing
  std::uint64_t seed = 0;
};

/// Writes a COLMAP scene: images/*.png, sparse/0/*.bin, and beside it depth/*.png (16 bit, millimetres of z),
/// normals/*.png (world frame, 127.5·(n + 1)), masks/*.png (objects white, room black). Same options, same bytes.
/// Throws InputError on impossible options.
void write_synthetic_scene(const SynthOptions& options);

}  // namespace splatboost

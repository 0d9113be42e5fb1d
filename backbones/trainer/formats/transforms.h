// SPDX-License-Identifier: Apache-2.0
/// @file transforms*.json of Blender (NeRF-synthetic, D-NeRF), nerfstudio and instant-ngp.
#pragma once

#include <filesystem>
#include <vector>

#include "trainer/dataset/view_image.h"

namespace splatboost {

struct Transforms {
  std::vector<Photo> photos;          ///< in the order of the file
  std::filesystem::path points_file;  ///< ply_file_path; empty if there is none
  bool timed = false;                 ///< whether the frames have times
  std::vector<bool> train;            ///< for each photo, whether train_filenames lists it; empty: no such list
  std::vector<bool> test;             ///< the same of test_filenames, or else of val_filenames
};

/// Reads one file. Intrinsics of a frame override those of the file, of which focal lengths and fields of view are
/// replaced together; poses are converted from OpenGL's convention (y
/// up, z backward, camera to world) to ours. Throws InputError on anything missing, not a number, or not supported.
Transforms read_transforms(const std::filesystem::path& file);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Rigs of film cameras as Neural 3D Video (Neu3D, DyNeRF) has them: poses_bounds.npy and a video a camera.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "trainer/dataset/view_image.h"

namespace splatboost {

struct NeuralVideo {
  std::vector<Photo> photos;  ///< camera by camera; those of the held-out one come last
  std::size_t test = 0;       ///< how many these are
  std::vector<std::string> notes;
};

/// Whether the folder holds one: poses_bounds.npy, and at least two videos cam*.mp4 or folders cam* of pictures. (A
/// still LLFF scene has the former too.)
bool is_neural_video(const std::filesystem::path& folder);

/// Lists the first frames of each camera, of a video those that can be read. The first camera is the test split.
/// @param frames how many; 0: all
/// Throws InputError in one line.
NeuralVideo read_neural_video(const std::filesystem::path& folder, int frames);

}  // namespace splatboost

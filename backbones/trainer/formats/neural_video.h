// SPDX-License-Identifier: Apache-2.0
/// @file Rigs of video cameras as in Neural 3D Video (Neu3D, DyNeRF): poses_bounds.npy and one video per camera.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "trainer/dataset/view_image.h"

namespace splatboost {

struct NeuralVideo {
  std::vector<Photo> photos;  ///< ordered by camera; the held-out camera comes last
  std::size_t test = 0;       ///< number of photos of the held-out camera
  std::vector<std::string> notes;
};

/// Whether the folder holds such a rig: poses_bounds.npy, and at least two videos cam*.mp4 or folders cam* of images.
/// (A static LLFF scene has poses_bounds.npy too.)
bool is_neural_video(const std::filesystem::path& folder);

/// Lists the first frames of each camera; of a video, only those that can be decoded. Times are linear in the number of
/// the frame: in a folder that in the picture's name, in a video the frame's index. The first camera is the test split.
/// @param frames number of different frames, from the first of the rig; 0: all
/// Throws InputError in one line.
NeuralVideo read_neural_video(const std::filesystem::path& folder, int frames);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Captures of Nerfies, HyperNeRF and NeRF-DS: dataset.json, metadata.json, scene.json, camera/*.json,
/// points.npy.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "trainer/dataset/view_image.h"

namespace splatboost {

struct NerfiesCapture {
  std::vector<Photo> photos;  ///< those of the test split come last
  std::size_t test = 0;       ///< how many these are
  PointCloud points;          ///< empty without points.npy
};

/// Whether the folder holds one.
bool is_nerfies_capture(const std::filesystem::path& folder);

/// Reads a capture with its times. The test split is val_ids where dataset.json names some; else, as HyperNeRF's
/// interpolation scenes have it, of ids every fourth is for training and every fourth, two behind it, for the test.
/// @param images below the folder, such as rgb/2x
/// Throws InputError in one line.
NerfiesCapture read_nerfies(const std::filesystem::path& folder, const std::string& images);

}  // namespace splatboost

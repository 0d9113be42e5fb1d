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
  std::vector<Photo> photos;  ///< photos of the test split come last
  std::size_t test = 0;       ///< number of photos in the test split
  PointCloud points;          ///< empty without points.npy
};

/// Whether the folder holds such a capture.
bool is_nerfies_capture(const std::filesystem::path& folder);

/// Reads a capture with its times. The test split is val_ids if dataset.json has any; else, as for HyperNeRF's
/// interpolation scenes, entries 0, 4, 8, … of ids are for training and entries 2, 6, 10, … for the test.
/// @param images image folder, relative to `folder`, such as rgb/2x
/// Throws InputError in one line.
NerfiesCapture read_nerfies(const std::filesystem::path& folder, const std::string& images);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Which photos of a dataset are trained on, and which are held out for the test.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "trainer/formats/read_scene.h"

namespace splatboost {

/// Indices of photos, in the dataset's order.
struct PhotoSplit {
  std::vector<std::size_t> train;
  std::vector<std::size_t> test;
  std::vector<std::string> notes;  ///< for the user
};

/// The photos named in options.test_list, else the dataset's own test split, else every llffhold-th photo are held out;
/// the latter two only with options.eval. Photos of the dataset's own test split that options.test_list does not name
/// are in neither part. Throws InputError if a name matches no photo, or none is left for training.
/// @param names of all photos; those of the dataset's own test split come last
/// @param own_test number of photos in that split; none: the dataset has none
/// @param listing the dataset's file, for error messages
PhotoSplit split_photos(const SceneOptions& options, const std::vector<std::string>& names,
                        std::optional<std::size_t> own_test, const std::filesystem::path& listing);

/// `count` photos evenly spaced from the first to the last. Indices are rounded half to even, as numpy does in the
/// published few-view splits.
std::vector<std::size_t> spread_evenly(const std::vector<std::size_t>& photos, std::size_t count);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file A dataset in one file, as decoded by its reader: loads fast, and without an image library. For the layout see
/// docs/formats.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "trainer/dataset/scene.h"

namespace splatboost {

/// One photo of a packed scene.
struct PackedPhoto {
  View view;            ///< without pixels in PackedScene::listing()
  int photo_width = 0;  ///< of the photo before it was reduced
  int photo_height = 0;
  bool transparent = false;
  bool masked = false;                         ///< some pixels have no data
  std::vector<std::uint8_t> color_over_white;  ///< [3,H,W] if transparent; view.color is over black
};

/// The content of a packed scene; after reading, without the pixels of its photos.
struct PackedListing {
  std::vector<PackedPhoto> photos;  ///< in the dataset's order; those of its own test split come last
  std::size_t own_test = 0;         ///< number of photos in that test split
  bool has_test_split = false;
  bool blender = false;       ///< if there are no points, they are sampled in the box of NeRF-synthetic
  std::string images;         ///< image folder of a COLMAP scene or a Nerfies capture
  std::optional<int> frames;  ///< --frames of a rig of videos, 0: all; unset: another dataset, or not known
  PointCloud points;
  std::map<int, PointCloud> few_view_points;  ///< by the number of views they were made from
};

/// Writes the file atomically. The photos must have their pixels.
void write_packed_scene(const std::filesystem::path& path, const PackedListing& dataset);

/// Whether the file begins like a packed scene of any version.
bool is_packed_scene(const std::filesystem::path& path);

/// A packed scene whose pixels stay on disk until load(). The constructor and load() throw InputError, in one line, if
/// the file is cut short, damaged or of another version.
class PackedScene {
 public:
  explicit PackedScene(std::filesystem::path path);
  const PackedListing& listing() const { return listing_; }
  /// Reads the photo with its pixels; transparent ones over white or black.
  View load(std::size_t index, bool white_background) const;

 private:
  std::filesystem::path path_;
  PackedListing listing_;
  std::vector<std::uint64_t> begins_;  ///< offset in the file of each photo's pixels
};

}  // namespace splatboost

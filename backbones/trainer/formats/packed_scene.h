// SPDX-License-Identifier: Apache-2.0
/// @file A dataset in one file, as its readers made it: read fast, and without an image library. docs/formats.md has
/// the layout.
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

/// What a packed scene says of one photo.
struct PackedPhoto {
  View view;            ///< without pixels in PackedListing
  int photo_width = 0;  ///< of the photo that was packed, before it was shrunk
  int photo_height = 0;
  bool transparent = false;
  bool masked = false;                         ///< some pixels have no data
  std::vector<std::uint8_t> color_over_white;  ///< [3,H,W] of a transparent photo; view.color is over black
};

/// All of a dataset but its pixels.
struct PackedListing {
  std::vector<PackedPhoto> photos;  ///< in the dataset's order; those of a test split of its own come last
  std::size_t own_test = 0;         ///< how many these are
  bool has_test_split = false;
  bool blender = false;       ///< points are drawn in the box of NeRF-synthetic, where there are none
  std::string images;         ///< image folder of a COLMAP scene or a Nerfies capture
  std::optional<int> frames;  ///< that were asked for of a rig of videos, 0: all; none: another dataset, or not known
  PointCloud points;
  std::map<int, PointCloud> few_view_points;  ///< by the number of views they were made of
};

/// Writes the file; see atomic_file.h. The photos hold their pixels.
void write_packed_scene(const std::filesystem::path& path, const PackedListing& dataset);

/// Whether the file begins as a packed scene does, of whatever version.
bool is_packed_scene(const std::filesystem::path& path);

/// A packed scene whose pixels are still on disk. Everything throws InputError, in one line, on a file that is cut
/// short, damaged or of a newer version.
class PackedScene {
 public:
  explicit PackedScene(std::filesystem::path path);
  const PackedListing& listing() const { return listing_; }
  /// The photo with its pixels.
  View load(std::size_t index, bool white_background) const;

 private:
  std::filesystem::path path_;
  PackedListing listing_;
  std::vector<std::uint64_t> begins_;  ///< where in the file the pixels of each photo lie
};

}  // namespace splatboost

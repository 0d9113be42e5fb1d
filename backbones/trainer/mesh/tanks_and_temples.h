// SPDX-License-Identifier: Apache-2.0
/// @file Files of the Tanks and Temples evaluation (Knapitsch et al. 2017): the crop volume of a scene, and the
/// transform of a reconstruction into its frame.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <vector>

namespace splatboost {

/// A polygon in a plane of two axes, between two heights along the third.
struct CropVolume {
  int axis = 2;  ///< axis of the heights: 0, 1, 2 for x, y, z
  double low = 0, high = 0;
  std::vector<std::array<double, 3>> polygon;
};

/// Reads the SelectionPolygonVolume of SCENE.json. Throws InputError.
CropVolume read_crop_volume(const std::filesystem::path& path);

/// The points [N,3] inside the volume.
std::vector<float> cropped(std::span<const float> points, const CropVolume& volume);

/// Reads a 4×4 matrix in row-major order (SCENE_trans.txt). Throws InputError.
std::array<double, 16> read_transform(const std::filesystem::path& path);

/// Applies the row-major transform to the points [N,3] in place.
void transform_points(const std::array<double, 16>& transform, std::span<float> points);

}  // namespace splatboost

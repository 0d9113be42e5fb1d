// SPDX-License-Identifier: Apache-2.0
/// @file Files of Tanks and Temples' evaluation (Knapitsch et al. 2017): where a scene is cropped, and how what was
/// reconstructed lies in it.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <vector>

namespace splatboost {

/// A polygon in a plane of two axes, between two heights along the third.
struct CropVolume {
  int axis = 2;  ///< of the heights: 0, 1, 2 for x, y, z
  double low = 0, high = 0;
  std::vector<std::array<double, 3>> polygon;
};

/// Reads the SelectionPolygonVolume of SCENE.json. Throws InputError.
CropVolume read_crop_volume(const std::filesystem::path& path);

/// The points [N,3] that lie in it.
std::vector<float> cropped(std::span<const float> points, const CropVolume& volume);

/// Reads 4×4 numbers, row by row (SCENE_trans.txt). Throws InputError.
std::array<double, 16> read_transform(const std::filesystem::path& path);

/// Moves the points.
void transform_points(const std::array<double, 16>& transform, std::span<float> points);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file The Tanks and Temples evaluation (Knapitsch et al. 2017): the crop volume of a scene, its threshold, and the
/// transform of a reconstruction into its frame.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "splatboost/threads.h"

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

/// The threshold τ of precision and recall in a scene of the training set, in metres; none for other names.
/// @param scene "Barn", as in Barn.json
std::optional<double> tanks_and_temples_threshold(std::string_view scene);

/// Reads an affine 4×4 matrix in row-major order (SCENE_trans.txt). Throws InputError.
std::array<double, 16> read_transform(const std::filesystem::path& path);

/// Applies the row-major affine transform to the points [N,3] in place. Throws InputError if a result is not finite.
void transform_points(const std::array<double, 16>& transform, std::span<float> points);

/// Refines an alignment by ICP: the similarity that brings the points [N,3] to the truth [M,3], row-major. Pairs of
/// nearest points within `volume` count up to a distance of 80, then 20, then 2 thresholds, as in the benchmark.
/// Throws InputError if no points are near enough to begin with.
std::array<double, 16> refined_alignment(std::span<const float> points, std::span<const float> truth,
                                         const CropVolume& volume, double threshold, const Threads& threads);

}  // namespace splatboost

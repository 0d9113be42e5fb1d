// SPDX-License-Identifier: Apache-2.0
/// @file How far two surfaces lie apart: Chamfer distance, precision, recall and F1.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "splatboost/threads.h"
#include "trainer/mesh/triangle_mesh.h"

namespace splatboost {

/// Points on the triangles, about `spacing` apart and evenly spread, with the vertices; a mesh without triangles gives
/// its vertices. @return [N,3]
std::vector<float> sample_surface(const TriangleMesh& mesh, double spacing);

/// Leaves of points, taken in an order that a seed draws, those that no point taken before lies within `radius` of
/// (DTU's down-sampling).
std::vector<float> thin_points(std::span<const float> points, double radius, std::uint64_t seed);

/// Distance of each point to the nearest of `others`, which must not be empty.
std::vector<double> nearest_distances(std::span<const float> points, std::span<const float> others, Threads& threads);

/// A box; points outside of it do not count.
struct CropBox {
  std::array<float, 3> low, high;
};
std::vector<float> cropped(std::span<const float> points, const CropBox& box);

struct SurfaceDistance {
  std::size_t found_points = 0, true_points = 0;
  double accuracy = 0;                       ///< mean distance of what was found to the truth
  double completeness = 0;                   ///< mean distance of the truth to what was found
  double chamfer = 0;                        ///< mean of both
  double median_accuracy = 0;                ///< half of what was found lies nearer
  double precision = 0, recall = 0, f1 = 0;  ///< shares within the threshold
};

/// @param threshold of precision and recall (tau of Tanks and Temples)
/// @param cut pairs that lie farther apart do not count in the means (DTU: 20 mm); none: all count
SurfaceDistance compare_surfaces(std::span<const float> found, std::span<const float> truth, double threshold,
                                 std::optional<double> cut, Threads& threads);

/// The same of distances that are known already, where not all of one surface is compared with all of the other.
/// @param to_truth of points that were found @param to_found of points of the truth; neither may be empty
SurfaceDistance summarize_distances(std::vector<double> to_truth, const std::vector<double>& to_found, double threshold,
                                    std::optional<double> cut);

}  // namespace splatboost

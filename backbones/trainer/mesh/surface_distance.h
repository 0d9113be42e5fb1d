// SPDX-License-Identifier: Apache-2.0
/// @file How far two surfaces lie apart: Chamfer distance, precision, recall and F1.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "splatboost/threads.h"
#include "trainer/mesh/triangle_mesh.h"

namespace splatboost {

/// Evenly spread points on the triangles, about `spacing` apart, and the vertices; a mesh without triangles gives its
/// vertices. Throws InputError if the spacing is far too small for the mesh. @return [N,3]
std::vector<float> sample_surface(const TriangleMesh& mesh, double spacing);

/// Visits the points in a random order given by `seed` and keeps each that has no kept point within `radius` (DTU's
/// down-sampling).
std::vector<float> thin_points(std::span<const float> points, double radius, std::uint64_t seed);

/// The mean of the points, which must be finite, in each voxel of a grid, in the order of the voxels (the resampling of
/// Tanks and Temples).
std::vector<float> voxel_means(std::span<const float> points, double size);

/// Finds the nearest of a set of points, by a k-d tree.
class PointTree {
 public:
  /// @param points [N,3], not empty; they must outlive the tree
  explicit PointTree(std::span<const float> points);
  ~PointTree();

  struct Nearest {
    std::size_t index;
    float squared_distance;
  };
  /// @param point [3]
  Nearest nearest(const float* point) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Distance of each point to the nearest of `others`, which must not be empty.
std::vector<double> nearest_distances(std::span<const float> points, std::span<const float> others,
                                      const Threads& threads);

/// An axis-aligned box; points outside it are ignored.
struct CropBox {
  std::array<float, 3> low, high;
};
std::vector<float> cropped(std::span<const float> points, const CropBox& box);

struct SurfaceDistance {
  std::size_t found_points = 0, true_points = 0;
  double accuracy = 0;                       ///< mean distance of found points to the truth
  double completeness = 0;                   ///< mean distance of true points to the found ones
  double chamfer = 0;                        ///< mean of both
  double median_accuracy = 0;                ///< median distance of found points to the truth
  double precision = 0, recall = 0, f1 = 0;  ///< shares of points within the threshold
};

/// @param threshold of precision and recall (tau of Tanks and Temples)
/// @param cut pairs that lie farther apart do not count in the means (DTU: 20 mm); none: all count
SurfaceDistance compare_surfaces(std::span<const float> found, std::span<const float> truth, double threshold,
                                 std::optional<double> cut, const Threads& threads);

/// The same from given distances, for cases where only part of one surface is compared with all of the other.
/// @param to_truth distances of the found points @param to_found distances of the true points; neither may be empty
SurfaceDistance summarize_distances(std::vector<double> to_truth, const std::vector<double>& to_found, double threshold,
                                    std::optional<double> cut);

}  // namespace splatboost

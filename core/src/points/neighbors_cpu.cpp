// SPDX-License-Identifier: Apache-2.0
#include "splatboost/neighbors.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <nanoflann.hpp>

#include "points/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

struct Points {
  std::span<const float> rows;
  std::size_t kdtree_get_point_count() const { return rows.size() / 3; }
  float kdtree_get_pt(std::size_t i, std::size_t axis) const { return rows[3 * i + axis]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>, Points, 3, std::uint32_t>;

}  // namespace

void mean_squared_neighbor_distances(std::span<const float> points, int k, std::span<float> mean_squared_distances,
                                     Device device) {
  const std::size_t n = points.size() / 3;
  SPLATBOOST_CHECK(points.size() == 3 * n && mean_squared_distances.size() == n, "points must be [N,3], distances [N]");
  SPLATBOOST_CHECK(k > 0, "k must be above 0");
  if (device.is_cuda()) {
    SPLATBOOST_CHECK(k <= cuda::kMaxNeighbors, "k is too large for a CUDA device");
    return cuda::mean_squared_neighbor_distances(points, k, mean_squared_distances, device.stream());
  }
  for (const float v : points) SPLATBOOST_CHECK(std::isfinite(v), "points must be finite");
  if (n == 0) return;
  const Points adaptor{points};
  const Tree tree(3, adaptor);
  // Plus the point itself, which is found first.
  const std::size_t wanted = std::min(n, static_cast<std::size_t>(k) + 1);
  device.threads().for_range(n, 256, [&](std::size_t begin, std::size_t end) {
    std::vector<std::uint32_t> indices(wanted);
    std::vector<float> squared(wanted);
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t found = tree.knnSearch(&points[3 * i], wanted, indices.data(), squared.data());
      // With coincident points the first result may be another point than the query; its distance is 0 as well.
      float sum = 0;
      for (std::size_t j = 1; j < found; ++j) sum += squared[j];
      mean_squared_distances[i] = found > 1 ? sum / static_cast<float>(found - 1) : 0.0f;
    }
  });
}

}  // namespace splatboost

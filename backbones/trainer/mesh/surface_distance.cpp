// SPDX-License-Identifier: Apache-2.0
#include "trainer/mesh/surface_distance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <nanoflann.hpp>

#include "splatboost/random.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 1024;
constexpr double kMaxSamples = 1 << 28;  ///< 3 GiB; a finer spacing is a mistake rather than a wish

/// [N,3] as nanoflann reads it.
struct Points {
  std::span<const float> values;
  std::size_t kdtree_get_point_count() const { return values.size() / 3; }
  float kdtree_get_pt(std::size_t i, std::size_t c) const { return values[3 * i + c]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};
using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>, Points, 3, std::uint32_t>;

glm::dvec3 vertex(const TriangleMesh& mesh, std::size_t v) {
  return {mesh.positions[3 * v], mesh.positions[3 * v + 1], mesh.positions[3 * v + 2]};
}

double mean_below(const std::vector<double>& distances, std::optional<double> cut) {
  double sum = 0;
  std::size_t count = 0;
  for (const double d : distances) {
    if (cut && !(d < *cut)) continue;
    sum += d;
    ++count;
  }
  require(count > 0,
          "no point is closer to the other surface than --cut; check that the mesh is aligned with the true surface");
  return sum / static_cast<double>(count);
}

double share_below(const std::vector<double>& distances, double threshold) {
  const auto near = std::count_if(distances.begin(), distances.end(), [&](double d) { return d < threshold; });
  return static_cast<double>(near) / static_cast<double>(distances.size());
}

}  // namespace

std::vector<float> sample_surface(const TriangleMesh& mesh, double spacing) {
  std::vector<float> points = mesh.positions;
  double samples = static_cast<double>(mesh.vertices());
  for (std::size_t t = 0; t < mesh.size(); ++t) {
    const glm::dvec3 a = vertex(mesh, mesh.triangles[3 * t]), b = vertex(mesh, mesh.triangles[3 * t + 1]),
                     c = vertex(mesh, mesh.triangles[3 * t + 2]);
    const double longest = std::max({glm::length(b - a), glm::length(c - a), glm::length(c - b)});
    const double along = std::ceil(longest / spacing);
    samples += along > 1 ? along * (along + 1) / 2 : 0;
    if (!(samples < kMaxSamples)) {
      throw InputError("a spacing of " + readable(static_cast<float>(spacing)).dump() +
                       " is too small: the surface would have more than " +
                       std::to_string(static_cast<long>(kMaxSamples)) +
                       " points; give a larger --spacing or --threshold");
    }
    const int steps = static_cast<int>(along);
    // The vertices are already among the points; a triangle no longer than the spacing needs no more.
    for (int i = 0; i < steps && steps > 1; ++i) {
      for (int j = 0; i + j < steps; ++j) {
        const double u = (i + 1.0 / 3) / steps, v = (j + 1.0 / 3) / steps;
        const glm::dvec3 point = a + u * (b - a) + v * (c - a);
        for (int k = 0; k < 3; ++k) points.push_back(static_cast<float>(point[k]));
      }
    }
  }
  return points;
}

std::vector<float> thin_points(std::span<const float> points, double radius, std::uint64_t seed) {
  const std::size_t n = points.size() / 3;
  if (n == 0) return {};
  const RandomStream random(seed, 0, RandomPurpose::init_points);
  std::vector<std::uint32_t> order(n);
  std::iota(order.begin(), order.end(), 0u);
  for (std::size_t i = n; i > 1; --i) std::swap(order[i - 1], order[random.below(i, i)]);
  const Points data{points};
  const Tree tree(3, data, nanoflann::KDTreeSingleIndexAdaptorParams(16));
  std::vector<std::uint8_t> gone(n, 0);
  std::vector<float> kept;
  std::vector<std::pair<std::uint32_t, float>> found;
  for (const std::uint32_t i : order) {
    if (gone[i] != 0) continue;
    kept.insert(kept.end(), &points[3 * i], &points[3 * i] + 3);
    tree.radiusSearch(&points[3 * i], static_cast<float>(radius * radius), found,
                      nanoflann::SearchParams(32, 0, false));
    for (const auto& [near, distance] : found) gone[near] = 1;
  }
  return kept;
}

std::vector<float> voxel_means(std::span<const float> points, double size) {
  struct Member {
    std::array<double, 3> voxel;  ///< integers, which may be too large for integer types
    std::size_t point;
  };
  std::vector<Member> members(points.size() / 3);
  for (std::size_t i = 0; i < members.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      members[i].voxel[c] = std::floor(static_cast<double>(points[3 * i + c]) / size);
    }
    members[i].point = i;
  }
  std::sort(members.begin(), members.end(), [](const Member& a, const Member& b) {
    return a.voxel < b.voxel || (a.voxel == b.voxel && a.point < b.point);
  });
  std::vector<float> means;
  for (std::size_t begin = 0, end = 0; begin < members.size(); begin = end) {
    std::array<double, 3> sum{};
    for (; end < members.size() && members[end].voxel == members[begin].voxel; ++end) {
      for (std::size_t c = 0; c < 3; ++c) sum[c] += static_cast<double>(points[3 * members[end].point + c]);
    }
    for (const double value : sum) means.push_back(static_cast<float>(value / static_cast<double>(end - begin)));
  }
  return means;
}

struct PointTree::State {
  explicit State(std::span<const float> points)
      : data{points}, tree(3, data, nanoflann::KDTreeSingleIndexAdaptorParams(16)) {}
  Points data;
  Tree tree;
};

PointTree::PointTree(std::span<const float> points) {
  require(!points.empty(), "there is no surface to measure the distance to");
  state_ = std::make_unique<State>(points);
}
PointTree::~PointTree() = default;

PointTree::Nearest PointTree::nearest(const float* point) const {
  std::uint32_t index = 0;
  float squared = 0;
  state_->tree.knnSearch(point, 1, &index, &squared);
  return {index, squared};
}

std::vector<double> nearest_distances(std::span<const float> points, std::span<const float> others,
                                      const Threads& threads) {
  const PointTree tree(others);
  std::vector<double> distances(points.size() / 3);
  threads.for_range(distances.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      distances[i] = std::sqrt(static_cast<double>(tree.nearest(&points[3 * i]).squared_distance));
    }
  });
  return distances;
}

std::vector<float> cropped(std::span<const float> points, const CropBox& box) {
  std::vector<float> inside;
  for (std::size_t i = 0; i + 2 < points.size(); i += 3) {
    bool in = true;
    for (std::size_t c = 0; c < 3; ++c) in = in && points[i + c] >= box.low[c] && points[i + c] <= box.high[c];
    if (in) inside.insert(inside.end(), &points[i], &points[i] + 3);
  }
  return inside;
}

SurfaceDistance compare_surfaces(std::span<const float> found, std::span<const float> truth, double threshold,
                                 std::optional<double> cut, const Threads& threads) {
  require(!found.empty(), "no point of the mesh is to be compared: does it lie in the volume of --crop? (--align)");
  require(!truth.empty(), "no point of the true surface is to be compared: does it lie in the volume of --crop?");
  return summarize_distances(nearest_distances(found, truth, threads), nearest_distances(truth, found, threads),
                             threshold, cut);
}

SurfaceDistance summarize_distances(std::vector<double> to_truth, const std::vector<double>& to_found, double threshold,
                                    std::optional<double> cut) {
  require(!to_truth.empty(), "no point of the mesh is to be compared");
  require(!to_found.empty(), "no point of the true surface is to be compared");
  SurfaceDistance out;
  out.found_points = to_truth.size();
  out.true_points = to_found.size();
  out.accuracy = mean_below(to_truth, cut);
  out.completeness = mean_below(to_found, cut);
  out.chamfer = 0.5 * (out.accuracy + out.completeness);
  out.precision = share_below(to_truth, threshold);
  out.recall = share_below(to_found, threshold);
  const double sum = out.precision + out.recall;
  out.f1 = sum > 0 ? 2 * out.precision * out.recall / sum : 0.0;
  const auto middle = to_truth.begin() + static_cast<std::ptrdiff_t>(to_truth.size() / 2);
  std::nth_element(to_truth.begin(), middle, to_truth.end());
  out.median_accuracy = *middle;
  return out;
}

}  // namespace splatboost

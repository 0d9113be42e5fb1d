// SPDX-License-Identifier: Apache-2.0
#include "trainer/mesh/tanks_and_temples.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>
#include <utility>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "trainer/mesh/surface_distance.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

namespace splatboost {
namespace {

constexpr std::pair<const char*, double> kThresholds[] = {
    {"Barn", 0.01},      {"Caterpillar", 0.005}, {"Church", 0.025}, {"Courthouse", 0.025},
    {"Ignatius", 0.003}, {"Meetingroom", 0.01},  {"Truck", 0.005}};

/// A stage of the refinement. Lengths are in thresholds.
struct IcpStage {
  double spacing, farthest;
};
constexpr IcpStage kIcpStages[] = {{1, 80}, {0.5, 20}, {0.5, 2}};
constexpr int kIcpSteps = 20;        // at most, per stage
constexpr double kIcpChange = 1e-6;  // of the mean distance, relative: the stage has converged
constexpr std::size_t kIcpPairs = 3;
constexpr std::size_t kGrain = 1024;

using Matrix = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

std::array<double, 16> rows_of(const Matrix& matrix) {
  std::array<double, 16> rows{};
  std::copy(matrix.data(), matrix.data() + rows.size(), rows.begin());
  return rows;
}

}  // namespace

CropVolume read_crop_volume(const std::filesystem::path& path) {
  const nlohmann::json json = read_json_file(path);
  const std::string file = path.string();
  CropVolume volume;
  try {
    const auto axis = json.at("orthogonal_axis").get<std::string>();
    require(axis == "X" || axis == "Y" || axis == "Z", file + ": orthogonal_axis must be X, Y or Z");
    volume.axis = axis[0] - 'X';
    volume.low = json.at("axis_min").get<double>();
    volume.high = json.at("axis_max").get<double>();
    volume.polygon = json.at("bounding_polygon").get<std::vector<std::array<double, 3>>>();
  } catch (const nlohmann::json::exception&) {
    throw InputError(file + ": needs orthogonal_axis, axis_min, axis_max and bounding_polygon of points [x, y, z]");
  }
  require(volume.polygon.size() >= 3, file + ": bounding_polygon needs at least 3 points");
  return volume;
}

std::vector<float> cropped(std::span<const float> points, const CropVolume& volume) {
  const auto axis = static_cast<std::size_t>(volume.axis), u = (axis + 1) % 3, v = (axis + 2) % 3;
  std::vector<float> inside;
  for (std::size_t i = 0; i + 2 < points.size(); i += 3) {
    const double p[3] = {static_cast<double>(points[i]), static_cast<double>(points[i + 1]),
                         static_cast<double>(points[i + 2])};
    if (!(p[axis] >= volume.low && p[axis] <= volume.high)) continue;
    bool in = false;  // a ray along u crosses an odd number of edges
    for (std::size_t k = 0, last = volume.polygon.size() - 1; k < volume.polygon.size(); last = k++) {
      const auto &a = volume.polygon[k], &b = volume.polygon[last];
      if ((a[v] > p[v]) != (b[v] > p[v]) && p[u] < (b[u] - a[u]) * (p[v] - a[v]) / (b[v] - a[v]) + a[u]) in = !in;
    }
    if (in) inside.insert(inside.end(), &points[i], &points[i] + 3);
  }
  return inside;
}

std::array<double, 16> read_transform(const std::filesystem::path& path) {
  std::ifstream in(path);
  require(in.is_open(), path.string() + ": cannot be read");
  const std::string wrong = path.string() + ": must hold the 16 numbers of a 4x4 matrix, row by row, and nothing else";
  std::array<double, 16> transform{};
  for (double& value : transform) require(static_cast<bool>(in >> value) && std::isfinite(value), wrong);
  require((in >> std::ws).eof(), wrong);
  // A matrix stored by columns would otherwise lose its translation.
  require(transform[12] == 0 && transform[13] == 0 && transform[14] == 0 && transform[15] == 1,
          path.string() + ": the last row of the matrix must be 0 0 0 1");
  return transform;
}

void transform_points(const std::array<double, 16>& m, std::span<float> points) {
  constexpr double kMost = std::numeric_limits<float>::max();
  bool finite = true;
  for (std::size_t i = 0; i + 2 < points.size(); i += 3) {
    const double p[4] = {static_cast<double>(points[i]), static_cast<double>(points[i + 1]),
                         static_cast<double>(points[i + 2]), 1};
    for (std::size_t row = 0; row < 3; ++row) {
      double sum = 0;
      for (std::size_t column = 0; column < 4; ++column) sum += m[4 * row + column] * p[column];
      finite = finite && std::abs(sum) <= kMost;  // fails for NaN
      points[i + row] = static_cast<float>(sum);
    }
  }
  require(finite, "the alignment moves points to coordinates that are not finite; check --align or --trajectory");
}

std::optional<double> tanks_and_temples_threshold(std::string_view scene) {
  for (const auto& [name, threshold] : kThresholds) {
    if (scene == name) return threshold;
  }
  return std::nullopt;
}

std::array<double, 16> refined_alignment(std::span<const float> points, std::span<const float> truth,
                                         const CropVolume& volume, double threshold, const Threads& threads) {
  const std::vector<float> inside = cropped(truth, volume);
  Matrix refined = Matrix::Identity();
  for (const IcpStage& stage : kIcpStages) {
    const std::vector<float> targets = voxel_means(inside, stage.spacing * threshold);
    std::vector<float> sources(points.begin(), points.end());
    transform_points(rows_of(refined), sources);
    sources = voxel_means(cropped(sources, volume), stage.spacing * threshold);
    require(
        !targets.empty() && !sources.empty(),
        "no points of the mesh or of the truth lie in the crop volume: is the mesh in the truth's frame? (--align)");
    const PointTree tree(targets);
    const double farthest = stage.farthest * threshold;
    std::vector<PointTree::Nearest> nearest(sources.size() / 3);
    double before = -1;
    for (int step = 0; step < kIcpSteps; ++step) {
      threads.for_range(nearest.size(), kGrain, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) nearest[i] = tree.nearest(&sources[3 * i]);
      });
      std::vector<double> from, to;
      double sum = 0;
      for (std::size_t i = 0; i < nearest.size(); ++i) {
        const double distance = std::sqrt(static_cast<double>(nearest[i].squared_distance));
        if (!(distance < farthest)) continue;
        sum += distance;
        from.insert(from.end(), &sources[3 * i], &sources[3 * i] + 3);
        to.insert(to.end(), &targets[3 * nearest[i].index], &targets[3 * nearest[i].index] + 3);
      }
      const auto pairs = static_cast<Eigen::Index>(from.size() / 3);
      require(from.size() >= 3 * kIcpPairs,
              "too little of the mesh is near the truth to refine its alignment; check --align");
      const double mean = sum / static_cast<double>(pairs);
      if (before >= 0 && std::abs(before - mean) <= kIcpChange * before) break;
      before = mean;
      using Columns = Eigen::Map<const Eigen::Matrix3Xd>;
      const Matrix motion = Eigen::umeyama(Columns(from.data(), 3, pairs), Columns(to.data(), 3, pairs), true);
      transform_points(rows_of(motion), sources);
      refined = motion * refined;
    }
  }
  return rows_of(refined);
}

}  // namespace splatboost

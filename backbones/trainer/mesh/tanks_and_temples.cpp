// SPDX-License-Identifier: Apache-2.0
#include "trainer/mesh/tanks_and_temples.h"

#include <cmath>
#include <fstream>
#include <string>

#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

namespace splatboost {

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
    if (p[axis] < volume.low || p[axis] > volume.high) continue;
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
  std::array<double, 16> transform{};
  for (double& value : transform) {
    require(static_cast<bool>(in >> value) && std::isfinite(value),
            path.string() + ": must hold the 16 numbers of a 4x4 matrix, row by row");
  }
  return transform;
}

void transform_points(const std::array<double, 16>& m, std::span<float> points) {
  for (std::size_t i = 0; i + 2 < points.size(); i += 3) {
    const double p[4] = {static_cast<double>(points[i]), static_cast<double>(points[i + 1]),
                         static_cast<double>(points[i + 2]), 1};
    for (std::size_t row = 0; row < 3; ++row) {
      double sum = 0;
      for (std::size_t column = 0; column < 4; ++column) sum += m[4 * row + column] * p[column];
      points[i + row] = static_cast<float>(sum);
    }
  }
}

}  // namespace splatboost

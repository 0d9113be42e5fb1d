// SPDX-License-Identifier: Apache-2.0
#include "octree_gs/octree_levels.h"

#include <algorithm>
#include <cmath>

#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

/// With linear interpolation, like torch.quantile.
float quantile(std::vector<float>& values, double q) {
  const double at = q * static_cast<double>(values.size() - 1);
  const auto below = values.begin() + static_cast<std::ptrdiff_t>(at);
  std::nth_element(values.begin(), below, values.end());
  const float low = *below;
  const double part = at - std::floor(at);
  if (part == 0) return low;
  const float high = *std::min_element(below + 1, values.end());
  return static_cast<float>(low + part * (high - low));
}

}  // namespace

LevelRounding level_rounding_named(std::string_view name) {
  if (name == "floor") return LevelRounding::floor;
  return name == "ceil" ? LevelRounding::ceil : LevelRounding::round;
}

LevelRange measure_levels(std::span<const float> points, const std::vector<View>& views, double ratio, int fork) {
  std::vector<float> ends, distances;
  for (const View& view : views) {
    const glm::vec3 centre = view.camera.centre();
    distances.clear();
    for (std::size_t i = 0; i < points.size(); i += 3) {
      distances.push_back(std::hypot(points[i] - centre.x, points[i + 1] - centre.y, points[i + 2] - centre.z));
    }
    ends.push_back(quantile(distances, 1 - ratio));
    ends.push_back(quantile(distances, ratio));
  }
  LevelRange range;
  range.standard_distance = quantile(ends, ratio);
  const float nearest = quantile(ends, 1 - ratio);
  require(nearest > 0,
          "a camera of the scene is at the position of a point, so no level of detail is fine enough for it");
  range.levels = static_cast<int>(std::nearbyint(std::log2(range.standard_distance / nearest) /
                                                 std::log2(static_cast<float>(fork)))) +
                 1;
  return range;
}

std::vector<double> opening_iterations(int count, double end, double factor) {
  std::vector<double> at;
  if (count <= 0) return at;
  const double q = 1 / factor;
  double interval = end * (1 - q) / (1 - std::pow(q, count));
  double sum = 0;
  for (int i = 0; i < count; ++i) {
    sum += interval;
    interval *= q;
    at.push_back(sum);
  }
  return at;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/photo_difference.h"

#include <cmath>
#include <cstddef>
#include <cstdint>

#include <glm/vec3.hpp>

namespace splatboost {
namespace {

constexpr int kPatch = 2;  ///< px around a pixel that are compared

/// Between pixels; none outside of the picture and where it is masked.
std::optional<double> grey_at(const ViewFeatures& view, const glm::dvec2& pixel) {
  const double x = pixel.x - 0.5, y = pixel.y - 0.5;
  const double left = std::floor(x), top = std::floor(y);
  if (!(left >= 0 && top >= 0 && left + 1 < view.width && top + 1 < view.height)) return std::nullopt;
  const auto width = static_cast<std::size_t>(view.width);
  const std::size_t at = static_cast<std::size_t>(top) * width + static_cast<std::size_t>(left);
  if (!view.valid.empty()) {
    const std::uint8_t* const m = view.valid.data() + at;
    if (m[0] == 0 || m[1] == 0 || m[width] == 0 || m[width + 1] == 0) return std::nullopt;
  }
  const std::uint8_t* const p = view.grey.data() + at;
  const double u = x - left, v = y - top;
  return (1 - v) * ((1 - u) * p[0] + u * p[1]) + v * ((1 - u) * p[width] + u * p[width + 1]);
}

}  // namespace

std::optional<double> photo_difference(const ViewFeatures& view, const glm::dvec2& pixel, double depth,
                                       const ViewFeatures& other) {
  double sum = 0;
  int count = 0;
  for (int dy = -kPatch; dy <= kPatch; ++dy) {
    for (int dx = -kPatch; dx <= kPatch; ++dx) {
      const glm::dvec2 at = pixel + glm::dvec2(dx, dy);
      const std::optional<double> here = grey_at(view, at);
      if (!here) continue;
      const glm::dvec3 p = other.to_camera(view.at_depth(at, depth));
      if (!(p.z > 0)) return std::nullopt;
      const std::optional<double> there = grey_at(other, other.project(p));
      if (!there) return std::nullopt;
      sum += std::abs(*here - *there);
      ++count;
    }
  }
  if (count == 0) return std::nullopt;
  return sum / count;
}

}  // namespace splatboost

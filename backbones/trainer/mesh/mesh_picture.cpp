// SPDX-License-Identifier: Apache-2.0
#include "trainer/mesh/mesh_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

namespace splatboost {
namespace {

constexpr double kNear = 1e-6;    // nearest depth drawn
constexpr double kDarkest = 0.1;  // shade of surfaces seen edge-on
constexpr double kPixelCenter = 0.5;

/// Twice the signed area of a triangle.
double area(glm::dvec2 a, glm::dvec2 b, glm::dvec2 c) { return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x); }

}  // namespace

std::vector<std::uint8_t> draw_mesh(const TriangleMesh& mesh, const Camera& camera) {
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  std::vector<glm::dvec3> points;
  points.reserve(mesh.vertices());
  for (std::size_t v = 0; v < mesh.vertices(); ++v) {
    const float* at = &mesh.positions[3 * v];
    points.emplace_back(camera.camera_from_world * glm::vec4(at[0], at[1], at[2], 1));
  }
  std::vector<double> nearest(width * height, 0.0);  // inverse depth
  std::vector<std::uint8_t> picture(width * height, 0);
  for (std::size_t t = 0; t < mesh.size(); ++t) {
    std::array<glm::dvec3, 3> corner;
    std::array<glm::dvec2, 3> on_screen;
    double closest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < 3; ++i) {
      corner[i] = points[mesh.triangles[3 * t + i]];
      on_screen[i] = {camera.fx * corner[i].x / corner[i].z + camera.cx,
                      camera.fy * corner[i].y / corner[i].z + camera.cy};
      closest = std::min(closest, corner[i].z);
    }
    if (!(closest > kNear)) continue;
    const double whole = area(on_screen[0], on_screen[1], on_screen[2]);
    if (!(std::abs(whole) > 0)) continue;
    const glm::dvec3 normal = glm::cross(corner[1] - corner[0], corner[2] - corner[0]);
    const glm::dvec3 middle = corner[0] + corner[1] + corner[2];
    const double facing = std::abs(glm::dot(normal, middle)) / (glm::length(normal) * glm::length(middle));
    const auto shade =
        static_cast<std::uint8_t>(std::lround(255 * (kDarkest + (1 - kDarkest) * std::min(1.0, facing))));

    const auto [left, right] = std::minmax({on_screen[0].x, on_screen[1].x, on_screen[2].x});
    const auto [top, bottom] = std::minmax({on_screen[0].y, on_screen[1].y, on_screen[2].y});
    // Range of pixels whose centres may lie inside the triangle.
    const auto from = [](double low) { return static_cast<std::size_t>(std::max(0.0, std::ceil(low - kPixelCenter))); };
    const auto to = [](double high, std::size_t most) {
      return static_cast<std::size_t>(std::clamp(std::floor(high - kPixelCenter) + 1, 0.0, static_cast<double>(most)));
    };
    for (std::size_t y = from(top); y < to(bottom, height); ++y) {
      for (std::size_t x = from(left); x < to(right, width); ++x) {
        const glm::dvec2 pixel{static_cast<double>(x) + kPixelCenter, static_cast<double>(y) + kPixelCenter};
        const double a = area(pixel, on_screen[1], on_screen[2]) / whole;
        const double b = area(on_screen[0], pixel, on_screen[2]) / whole;
        const double c = 1 - a - b;
        if (a < 0 || b < 0 || c < 0) continue;
        // Inverse depth is linear on screen.
        const double inverse = a / corner[0].z + b / corner[1].z + c / corner[2].z;
        if (inverse <= nearest[y * width + x]) continue;
        nearest[y * width + x] = inverse;
        picture[y * width + x] = shade;
      }
    }
  }
  return picture;
}

}  // namespace splatboost

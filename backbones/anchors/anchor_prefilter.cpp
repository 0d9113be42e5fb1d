// SPDX-License-Identifier: Apache-2.0
#include "anchors/anchor_prefilter.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "splatboost/constants.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 2048;

/// The camera in the form that the test reads.
struct Screen {
  explicit Screen(const Camera& camera)
      : view(camera),
        axes(glm::transpose(camera.rotation())),
        limit_x(kFieldOfViewMargin * 0.5f * static_cast<float>(camera.width) / camera.fx),
        limit_y(kFieldOfViewMargin * 0.5f * static_cast<float>(camera.height) / camera.fy) {}
  const Camera& view;
  glm::mat3 axes;  ///< columns: right, down and forward in the world
  float limit_x, limit_y;

  /// Whether [centre ± radius] meets a tile of an axis of `size` pixels. 3DGS counts pixel centres at whole numbers.
  static bool meets(float mean, float radius, int size) {
    const float tiles = static_cast<float>((size + kTileSize - 1) / kTileSize);
    const float first = std::floor((mean - 0.5f - radius) / kTileSize);
    const float last = std::floor((mean - 0.5f + radius + kTileSize - 1) / kTileSize);
    return std::clamp(first, 0.0f, tiles) < std::clamp(last, 0.0f, tiles);
  }

  bool sees(glm::vec3 position, glm::vec3 scale) const {
    const glm::vec3 p = view.rotation() * position + glm::vec3(view.camera_from_world[3]);
    if (!(p.z > kNearPlane)) return false;
    const float x = p.x / p.z, y = p.y / p.z;
    const float bounded_x = std::clamp(x, -limit_x, limit_x), bounded_y = std::clamp(y, -limit_y, limit_y);
    // Rows of the Jacobian of the projection, times the standard deviations: covariance on screen is their Gram matrix.
    const glm::vec3 row_x = view.fx / p.z * (axes[0] - bounded_x * axes[2]) * scale;
    const glm::vec3 row_y = view.fy / p.z * (axes[1] - bounded_y * axes[2]) * scale;
    const float xx = glm::dot(row_x, row_x) + kLowPass, yy = glm::dot(row_y, row_y) + kLowPass;
    const float xy = glm::dot(row_x, row_y);
    const float determinant = xx * yy - xy * xy, middle = 0.5f * (xx + yy);
    if (!(determinant > 0)) return false;
    const float longest = middle + std::sqrt(std::max(0.1f, middle * middle - determinant));
    const float radius = std::ceil(kBoxSigmas * std::sqrt(longest));
    return meets(view.fx * x + view.cx, radius, view.width) && meets(view.fy * y + view.cy, radius, view.height);
  }
};

}  // namespace

void anchors_in_view(const Camera& camera, std::span<const float> positions, std::span<const float> scales,
                     std::span<const std::uint8_t> candidates, Threads& threads, std::vector<std::uint8_t>& mask,
                     std::vector<std::uint32_t>& visible) {
  const std::size_t n = positions.size() / 3;
  mask.resize(n);
  const Screen screen(camera);
  threads.for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const float* p = &positions[3 * i];
      const float* s = &scales[6 * i];
      mask[i] =
          (candidates.empty() || candidates[i] != 0) && screen.sees({p[0], p[1], p[2]}, {s[0], s[1], s[2]}) ? 1 : 0;
    }
  });
  visible.clear();
  for (std::size_t i = 0; i < n; ++i) {
    if (mask[i] != 0) visible.push_back(static_cast<std::uint32_t>(i));
  }
}

}  // namespace splatboost

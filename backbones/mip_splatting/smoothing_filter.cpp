// SPDX-License-Identifier: Apache-2.0
#include "mip_splatting/smoothing_filter.h"

#include <algorithm>

#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#include "splatboost/constants.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 1024;

}  // namespace

void smoothing_filters(std::span<const float> means, const std::vector<View>& views, double variance, double margin,
                       std::span<float> filters, Threads& threads) {
  const auto deviation = static_cast<float>(std::sqrt(variance));
  const auto border = static_cast<float>(margin);
  threads.for_range(filters.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const glm::vec4 mean(means[3 * i], means[3 * i + 1], means[3 * i + 2], 1.0f);
      float rate = 0;
      for (const View& view : views) {
        const Camera& camera = view.camera;
        const glm::vec3 p(camera.camera_from_world * mean);
        if (!(p.z > kNearPlane)) continue;
        const float x = camera.fx * p.x / p.z + camera.cx, y = camera.fy * p.y / p.z + camera.cy;
        const auto width = static_cast<float>(camera.width), height = static_cast<float>(camera.height);
        const bool seen =
            x >= -border * width && x <= (1 + border) * width && y >= -border * height && y <= (1 + border) * height;
        if (seen) rate = std::max(rate, camera.fx / p.z);
      }
      filters[i] = rate > 0 ? deviation / rate : 0.0f;
    }
  });
  const auto largest = std::max_element(filters.begin(), filters.end());
  if (largest == filters.end()) return;
  const float of_unseen = *largest;
  for (float& filter : filters) {
    if (filter == 0) filter = of_unseen;
  }
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/scene_depths.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace splatboost {
namespace {

/// Views and points that are enough for a median; of more, an even subset is taken.
constexpr std::size_t kMostViews = 200, kMostPoints = 100000;

std::size_t step_of(std::size_t count, std::size_t most) { return (count + most - 1) / most; }

float median(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Calls visit(depths) with depths_in_view() of each view.
template <class Visit>
void visit_depths(const Scene& scene, const Visit& visit) {
  const std::size_t every_view = step_of(scene.train.size(), kMostViews);
  const std::size_t every_point = step_of(scene.points.size(), kMostPoints);
  for (std::size_t v = 0; v < scene.train.size(); v += every_view) {
    std::vector<float> depths = depths_in_view(scene.train[v].camera, scene.points, every_point);
    visit(depths);
  }
}

}  // namespace

std::vector<float> depths_in_view(const Camera& camera, const PointCloud& points, std::size_t every) {
  std::vector<float> depths;
  for (std::size_t i = 0; i < points.size(); i += every) {
    const float* at = &points.positions[3 * i];
    const glm::vec3 point(camera.camera_from_world * glm::vec4(at[0], at[1], at[2], 1));
    if (!(point.z > 0)) continue;
    const float x = camera.fx * point.x / point.z + camera.cx, y = camera.fy * point.y / point.z + camera.cy;
    const bool seen = x >= 0 && y >= 0 && x < static_cast<float>(camera.width) && y < static_cast<float>(camera.height);
    if (seen) depths.push_back(point.z);
  }
  return depths;
}

double typical_depth(const Scene& scene) {
  std::vector<float> of_views;
  visit_depths(scene, [&](std::vector<float>& depths) {
    if (!depths.empty()) of_views.push_back(median(depths));
  });
  return of_views.empty() ? 1.0 : static_cast<double>(median(of_views));
}

double share_nearer(const Scene& scene, double depth) {
  std::size_t all = 0, nearer = 0;
  visit_depths(scene, [&](const std::vector<float>& depths) {
    all += depths.size();
    nearer += static_cast<std::size_t>(
        std::ranges::count_if(depths, [&](float d) { return static_cast<double>(d) < depth; }));
  });
  return all == 0 ? 0 : static_cast<double>(nearer) / static_cast<double>(all);
}

}  // namespace splatboost

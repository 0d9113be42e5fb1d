// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/scene.h"

#include <algorithm>

#include <glm/geometric.hpp>

namespace splatboost {
namespace {

constexpr double kPoseError = 5e-7;  ///< of a camera's position, which is computed from a rounded pose; relative

}  // namespace

PointCloud starting_points(const Scene& scene) {
  PointCloud all = scene.points;
  const PointCloud& more = scene.more_points;
  all.positions.insert(all.positions.end(), more.positions.begin(), more.positions.end());
  all.colors.insert(all.colors.end(), more.colors.begin(), more.colors.end());
  return all;
}

bool moves(const Scene& scene) {
  return std::ranges::any_of(scene.train, [&](const View& view) { return view.time != scene.train.front().time; });
}

float camera_extent(const std::vector<View>& views) {
  if (views.empty()) return 0;
  glm::dvec3 mean(0.0);
  for (const View& view : views) mean += glm::dvec3(view.camera.centre());
  mean /= static_cast<double>(views.size());
  double farthest = 0;
  for (const View& view : views) farthest = std::max(farthest, glm::length(glm::dvec3(view.camera.centre()) - mean));
  return farthest > kPoseError * glm::length(mean) ? static_cast<float>(1.1 * farthest) : 0.0f;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/scene.h"

#include <algorithm>

#include <glm/geometric.hpp>

namespace splatboost {

float camera_extent(const std::vector<View>& views) {
  if (views.empty()) return 0;
  glm::dvec3 mean(0.0);
  for (const View& view : views) mean += glm::dvec3(view.camera.centre());
  mean /= static_cast<double>(views.size());
  double farthest = 0;
  for (const View& view : views) farthest = std::max(farthest, glm::length(glm::dvec3(view.camera.centre()) - mean));
  return static_cast<float>(1.1 * farthest);
}

}  // namespace splatboost

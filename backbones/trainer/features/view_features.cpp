// SPDX-License-Identifier: Apache-2.0
#include "trainer/features/view_features.h"

#include <algorithm>
#include <cmath>

#include "trainer/dataset/smaller_view.h"

namespace splatboost {

ViewFeatures reduced_camera(const View& view, int width, int height, double sx, double sy) {
  const Camera& camera = view.camera;
  ViewFeatures reduced;
  reduced.view = &view;
  reduced.width = width;
  reduced.height = height;
  reduced.fx = sx * static_cast<double>(camera.fx);
  reduced.fy = sy * static_cast<double>(camera.fy);
  reduced.cx = sx * static_cast<double>(camera.cx);
  reduced.cy = sy * static_cast<double>(camera.cy);
  reduced.rotation = glm::dmat3(camera.rotation());
  reduced.centre = glm::dvec3(camera.centre());
  return reduced;
}

ViewFeatures grey_view(const View& view) {
  const auto [shortest, longest] = std::minmax(view.camera.width, view.camera.height);
  const int divisor = std::min(shortest, (longest + kLongestSide - 1) / kLongestSide);
  const View smaller = smaller_view(view, divisor);
  ViewFeatures grey = reduced_camera(view, smaller.camera.width, smaller.camera.height, 1.0 / divisor, 1.0 / divisor);
  grey.valid = smaller.valid;
  const std::size_t plane = smaller.color.size() / 3;
  grey.grey.resize(plane);
  for (std::size_t i = 0; i < plane; ++i) {
    const std::uint8_t* const c = smaller.color.data() + i;
    grey.grey[i] =
        static_cast<std::uint8_t>(std::lround(0.299 * c[0] + 0.587 * c[plane] + 0.114 * c[2 * plane]));  // BT.601
  }
  return grey;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/view_features.h"

#include <algorithm>
#include <cmath>

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
  const Camera& camera = view.camera;
  const int factor = (std::max(camera.width, camera.height) + kLongestSide - 1) / kLongestSide;
  // At least one pixel: a very narrow photo is reduced along its length only.
  const int fx = std::min(factor, camera.width), fy = std::min(factor, camera.height);
  ViewFeatures grey = reduced_camera(view, camera.width / fx, camera.height / fy, 1.0 / fx, 1.0 / fy);
  const auto width = static_cast<std::size_t>(camera.width);
  const std::size_t plane = view.color.size() / 3;
  const std::uint8_t* const red = view.color.data();
  for (int row = 0; row < grey.height; ++row) {
    for (int column = 0; column < grey.width; ++column) {
      double sum = 0;
      for (int y = row * fy; y < (row + 1) * fy; ++y) {
        for (int x = column * fx; x < (column + 1) * fx; ++x) {
          const std::size_t at = static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x);
          sum += 0.299 * red[at] + 0.587 * red[plane + at] + 0.114 * red[2 * plane + at];  // BT.601
        }
      }
      grey.grey.push_back(static_cast<std::uint8_t>(std::lround(sum / (fx * fy))));
      if (!view.valid.empty()) {
        const auto y = static_cast<std::size_t>(row * fy + fy / 2), x = static_cast<std::size_t>(column * fx + fx / 2);
        grey.valid.push_back(view.valid[y * width + x] != 0 ? 1 : 0);
      }
    }
  }
  return grey;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "photo_slam/half_view.h"

namespace splatboost {

View half_view(const View& view) {
  View half;
  half.name = view.name;
  half.time = view.time;
  half.camera = view.camera;
  half.camera.width /= 2;
  half.camera.height /= 2;
  for (float* in_pixels : {&half.camera.fx, &half.camera.fy, &half.camera.cx, &half.camera.cy}) *in_pixels *= 0.5f;
  const auto width = static_cast<std::size_t>(half.camera.width), height = static_cast<std::size_t>(half.camera.height);
  const auto full_width = static_cast<std::size_t>(view.camera.width);
  const std::size_t full_pixels = full_width * static_cast<std::size_t>(view.camera.height);
  half.color.resize(3 * width * height);
  if (!view.valid.empty()) half.valid.resize(width * height);
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t corner = 2 * y * full_width + 2 * x;
      const std::size_t from[4] = {corner, corner + 1, corner + full_width, corner + full_width + 1};
      unsigned sums[3] = {}, count = 0;
      for (const std::size_t pixel : from) {
        if (!view.valid.empty() && view.valid[pixel] == 0) continue;
        ++count;
        for (std::size_t c = 0; c < 3; ++c) sums[c] += view.color[c * full_pixels + pixel];
      }
      const std::size_t to = y * width + x;
      if (!half.valid.empty()) half.valid[to] = count > 0 ? 255 : 0;
      for (std::size_t c = 0; c < 3 && count > 0; ++c) {
        half.color[c * width * height + to] = static_cast<std::uint8_t>((sums[c] + count / 2) / count);
      }
    }
  }
  return half;
}

}  // namespace splatboost

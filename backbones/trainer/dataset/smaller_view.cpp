// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/smaller_view.h"

#include <algorithm>

namespace splatboost {

View smaller_view(const View& view, int divisor) {
  View out;
  out.name = view.name;
  out.time = view.time;
  out.camera = view.camera;
  const auto d = static_cast<float>(divisor);
  out.camera.width = view.camera.width / divisor;
  out.camera.height = view.camera.height / divisor;
  out.camera.fx /= d;
  out.camera.fy /= d;
  out.camera.cx /= d;
  out.camera.cy /= d;

  const auto step = static_cast<std::size_t>(divisor);
  const auto width = static_cast<std::size_t>(out.camera.width), height = static_cast<std::size_t>(out.camera.height);
  const auto wide = static_cast<std::size_t>(view.camera.width), high = static_cast<std::size_t>(view.camera.height);
  out.color.reserve(3 * width * height);
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t y = 0; y < height; ++y) {
      for (std::size_t x = 0; x < width; ++x) {
        std::size_t sum = 0;
        for (std::size_t j = 0; j < step; ++j) {
          for (std::size_t i = 0; i < step; ++i) sum += view.color[(c * high + y * step + j) * wide + x * step + i];
        }
        out.color.push_back(static_cast<std::uint8_t>((sum + step * step / 2) / (step * step)));
      }
    }
  }
  if (view.valid.empty()) return out;
  out.valid.reserve(width * height);
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      bool all = true;
      for (std::size_t j = 0; j < step; ++j) {
        for (std::size_t i = 0; i < step; ++i) all = all && view.valid[(y * step + j) * wide + x * step + i] != 0;
      }
      out.valid.push_back(all ? 1 : 0);
    }
  }
  return out;
}

std::vector<View> half_views(const std::vector<View>& views, const Threads& threads) {
  const bool all_large = std::all_of(views.begin(), views.end(), [](const View& view) {
    return std::min(view.camera.width, view.camera.height) >= 2 * kMinHalfSide;
  });
  if (!all_large) return {};
  std::vector<View> halves(views.size());
  threads.for_range(views.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) halves[i] = smaller_view(views[i], 2);
  });
  return halves;
}

}  // namespace splatboost

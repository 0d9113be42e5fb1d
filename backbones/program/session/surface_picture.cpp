// SPDX-License-Identifier: Apache-2.0
#include "program/session/surface_picture.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "splatboost/surface_depth.h"

namespace splatboost::program {
namespace {

constexpr float kMinAlpha = 0.5f;                      // least alpha of a pixel that shows a surface
constexpr double kNearShare = 0.02, kFarShare = 0.98;  // quantiles of the depths that limit the greys
constexpr float kFarthestGrey = 40, kNearestGrey = 255;

float at_share(std::vector<float>& values, double share) {
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

}  // namespace

SurfacePicture draw_surface(Backbone& backbone, const View& view, const Threads& threads) {
  const std::size_t pixels = static_cast<std::size_t>(view.camera.width) * static_cast<std::size_t>(view.camera.height);
  std::vector<float> color(3 * pixels), depth(pixels), alpha(pixels), normals(3 * pixels), inverse;
  backbone.render_surface(view.camera, view.time, std::nullopt, {color, depth, alpha});
  for (std::size_t p = 0; p < pixels; ++p) {
    if (!(alpha[p] >= kMinAlpha) || !std::isfinite(depth[p]) || !(depth[p] > 0)) depth[p] = 0;
    if (depth[p] > 0) inverse.push_back(1 / depth[p]);
  }
  depth_normals(view.camera, depth, normals, threads);

  SurfacePicture picture;
  picture.depth.assign(pixels, 0);
  picture.normals.assign(3 * pixels, 0);
  if (inverse.empty()) return picture;
  const float far = at_share(inverse, 1 - kFarShare), near = at_share(inverse, 1 - kNearShare);
  const float range = std::max(near - far, 1e-12f);
  for (std::size_t p = 0; p < pixels; ++p) {
    if (!(depth[p] > 0)) continue;
    const float nearness = std::clamp((1 / depth[p] - far) / range, 0.0f, 1.0f);
    picture.depth[p] =
        static_cast<std::uint8_t>(std::lround(kFarthestGrey + (kNearestGrey - kFarthestGrey) * nearness));
    const float x = normals[p], y = normals[pixels + p], z = normals[2 * pixels + p];
    if (x == 0 && y == 0 && z == 0) continue;  // no normal there
    // In camera space y points down and z away from the camera; in the picture up and towards the camera are positive.
    const float shown[3] = {x, -y, -z};
    for (std::size_t c = 0; c < 3; ++c) {
      picture.normals[3 * p + c] =
          static_cast<std::uint8_t>(std::lround(127.5f * (1 + std::clamp(shown[c], -1.0f, 1.0f))));
    }
  }
  return picture;
}

}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
/// @file Visibility test of an anchor, shared by all devices.
#pragma once

#include <algorithm>
#include <cmath>

#include "families/nets/shared_math.h"
#include "projection/projection_camera.h"
#include "splatboost/constants.h"

namespace splatboost {

/// Camera data for the test.
struct AnchorScreen {
  explicit AnchorScreen(const Camera& view)
      : camera(make_projection_camera(view)), width(view.width), height(view.height) {}
  ProjectionCamera camera;
  int width, height;
};

/// Whether [mean ± radius] overlaps a tile along an axis of `size` pixels. Subtracts 0.5 because pixel centres of 3DGS
/// are at integers.
SPLATBOOST_SHARED_MATH bool meets_tiles(float mean, float radius, int size) {
  const int rounded_up = (size + kTileSize - 1) / kTileSize;
  const auto tiles = static_cast<float>(rounded_up);
  const float first = std::floor((mean - 0.5f - radius) / kTileSize);
  const float last = std::floor((mean - 0.5f + radius + kTileSize - 1) / kTileSize);
  return std::clamp(first, 0.0f, tiles) < std::clamp(last, 0.0f, tiles);
}

/// Whether the 3σ square of an anchor's own ellipsoid overlaps a tile.
/// @param position [3] @param scale [3] standard deviations along the world axes
SPLATBOOST_SHARED_MATH bool sees_anchor(const AnchorScreen& screen, const float* position, const float* scale) {
  const ProjectionCamera& camera = screen.camera;
  const auto along = [&](const float* axis) {
    return axis[0] * position[0] + axis[1] * position[1] + axis[2] * position[2];
  };
  const float z = along(camera.axis_z) + camera.translation[2];
  if (!(z > kNearPlane)) return false;
  const float x = (along(camera.axis_x) + camera.translation[0]) / z;
  const float y = (along(camera.axis_y) + camera.translation[1]) / z;
  const float bounded_x = std::clamp(x, camera.low_x, camera.high_x);
  const float bounded_y = std::clamp(y, camera.low_y, camera.high_y);
  // Rows of the projection's Jacobian times the standard deviations; their Gram matrix is the screen covariance.
  float row_x[3], row_y[3];
  for (int k = 0; k < 3; ++k) {
    row_x[k] = camera.fx / z * (camera.axis_x[k] - bounded_x * camera.axis_z[k]) * scale[k];
    row_y[k] = camera.fy / z * (camera.axis_y[k] - bounded_y * camera.axis_z[k]) * scale[k];
  }
  const auto product = [](const float* a, const float* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
  const float xx = product(row_x, row_x) + kLowPass, yy = product(row_y, row_y) + kLowPass;
  const float xy = product(row_x, row_y);
  const float determinant = xx * yy - xy * xy, middle = 0.5f * (xx + yy);
  if (!(determinant > 0)) return false;
  const float longest = middle + std::sqrt(std::max(0.1f, middle * middle - determinant));
  const float radius = std::ceil(kBoxSigmas * std::sqrt(longest));
  return meets_tiles(camera.fx * x + camera.cx, radius, screen.width) &&
         meets_tiles(camera.fy * y + camera.cy, radius, screen.height);
}

}  // namespace splatboost

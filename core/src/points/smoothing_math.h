// SPDX-License-Identifier: Apache-2.0
/// @file The sampling rate of a view at a point.
#pragma once

#include "device/host_device.h"
#include "splatboost/camera.h"
#include "splatboost/constants.h"

namespace splatboost {

/// Focal length / depth, px per world unit; 0 if the view does not see the point.
SPLATBOOST_HOST_DEVICE float sampling_rate(const Camera& camera, const float (&mean)[3], float margin) {
  float p[3];
  for (int k = 0; k < 3; ++k) {
    p[k] = (camera.camera_from_world[0][k] * mean[0] + camera.camera_from_world[1][k] * mean[1]) +
           (camera.camera_from_world[2][k] * mean[2] + camera.camera_from_world[3][k]);
  }
  if (!(p[2] > kNearPlane)) return 0.0f;
  const float x = camera.fx * p[0] / p[2] + camera.cx, y = camera.fy * p[1] / p[2] + camera.cy;
  const auto width = static_cast<float>(camera.width), height = static_cast<float>(camera.height);
  const bool seen =
      x >= -margin * width && x <= (1 + margin) * width && y >= -margin * height && y <= (1 + margin) * height;
  return seen ? camera.fx / p[2] : 0.0f;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Clearance of one Gaussian from one camera.
#pragma once

#include "device/host_device.h"

namespace splatboost {

/// Squared, to leave the root for the nearest camera. @param x,y,z from the camera to the Gaussian, world units
SPLATBOOST_HOST_DEVICE float squared_clearance(float x, float y, float z, float distance) {
  return (x * x + y * y + z * z) / (distance * distance);
}

}  // namespace splatboost

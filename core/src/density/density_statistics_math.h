// SPDX-License-Identifier: Apache-2.0
/// @file Contribution of one Gaussian to the statistics of a view.
#pragma once

#include <cstddef>

#include "device/host_device.h"
#include "splatboost/density_statistics.h"

namespace splatboost {

// Unlike std::hypot, not protected against overflow, which cannot happen here.
SPLATBOOST_HOST_DEVICE float length_of(float x, float y) { return sqrtf(x * x + y * y); }

SPLATBOOST_HOST_DEVICE float absolute_norm_of(float x, float y, AbsoluteNorm norm) {
  return norm == AbsoluteNorm::sum ? x + y : length_of(x, y);
}

SPLATBOOST_HOST_DEVICE float mean_over_views(float sum, float views) { return sum / max_of(views, 1.0f); }

}  // namespace splatboost

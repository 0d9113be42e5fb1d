// SPDX-License-Identifier: Apache-2.0
/// @file The error of one pixel, and when it is flagged (paper eqs. 6-8).
#pragma once

#include <cmath>
#include <cstddef>

#include "device/host_device.h"

namespace splatboost {

/// Keeps the min-max division defined (paper eq. 7); errors below it are equal for all purposes.
inline constexpr float kErrorEpsilon = 1e-8f;

/// Mean over channels |render − truth| at pixel p. @param render,truth [3, pixels]
template <class Colors, class Bytes>
SPLATBOOST_HOST_DEVICE float pixel_error(const Colors& render, const Bytes& truth, std::size_t p, std::size_t pixels) {
  float sum = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    sum += fabsf(render[c * pixels + p] - static_cast<float>(truth[c * pixels + p]) / 255.0f);
  }
  return sum / 3.0f;
}

/// A pixel is flagged if its error minus `low` exceeds this: infinite if the error is constant.
/// @param low,high least and greatest error of the view's valid pixels
SPLATBOOST_HOST_DEVICE float flag_threshold(float low, float high, float tau) {
  return high > low ? tau * (high - low + kErrorEpsilon) : HUGE_VALF;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Structural similarity of one pixel (Wang et al. 2004) and its derivatives.
#pragma once

#include "host_device.h"

namespace splatboost {

inline constexpr int kSsimRadius = 5;

/// Normalised Gaussian of σ 1.5 at -5 .. 5; symmetric, so the first half and the centre suffice.
inline constexpr float kSsimWindow[kSsimRadius + 1] = {0.00102838f, 0.00759876f, 0.03600077f,
                                                       0.10936069f, 0.21300554f, 0.26601172f};

struct SsimPixel {
  float value;
  float d_mean;     ///< d value / d E[x], E[x²] and E[xy] held
  float d_square;   ///< d value / d E[x²]
  float d_product;  ///< d value / d E[xy]
};

/// @param mx,my,xx,yy,xy windowed means of x, y, x², y², x·y (x: render, y: truth)
SPLATBOOST_HOST_DEVICE SsimPixel ssim_pixel(float mx, float my, float xx, float yy, float xy) {
  constexpr float c1 = 0.01f * 0.01f, c2 = 0.03f * 0.03f;
  const float a1 = 2.0f * mx * my + c1, a2 = 2.0f * (xy - mx * my) + c2;
  const float b1 = mx * mx + my * my + c1, b2 = (xx - mx * mx) + (yy - my * my) + c2;
  const float scale = 1.0f / (b1 * b2);
  SsimPixel s;
  s.value = a1 * a2 * scale;
  s.d_mean = 2.0f * my * (a2 - a1) * scale - 2.0f * mx * s.value * (1.0f / b1 - 1.0f / b2);
  s.d_square = -s.value / b2;
  s.d_product = 2.0f * a1 * scale;
  return s;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Structural similarity of one pixel (Wang et al. 2004) and its derivatives. T is any type of number (see
/// host_device.h).

#if defined(SPLATBOOST_PHOTOMETRIC_MATH_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_PHOTOMETRIC_MATH_H_
#undef SPLATBOOST_PHOTOMETRIC_MATH_H_
#else
#define SPLATBOOST_PHOTOMETRIC_MATH_H_
#endif

#include "device/host_device.h"
#include "loss/ssim_window.h"

SPLATBOOST_MATH_BEGIN

template <class T>
struct SsimPixel {
  T value;
  T d_mean;     ///< d value / d E[x], with E[x²] and E[xy] held constant
  T d_square;   ///< d value / d E[x²]
  T d_product;  ///< d value / d E[xy]
};

/// @param mx,my,squares,xy windowed means of x, y, x² + y², x·y (x: render, y: truth)
template <class T>
SPLATBOOST_HOST_DEVICE SsimPixel<T> ssim_pixel(T mx, T my, T squares, T xy) {
  const T c1(0.01f * 0.01f), c2(0.03f * 0.03f), two(2.0f);
  const T mxy = mx * my, means = mx * mx + my * my;
  const T a1 = two * mxy + c1, a2 = two * (xy - mxy) + c2;
  const T inverse_b1 = reciprocal_of(means + c1), inverse_b2 = reciprocal_of(squares - means + c2);
  const T scale = inverse_b1 * inverse_b2;
  SsimPixel<T> s;
  s.value = a1 * a2 * scale;
  s.d_mean = two * (my * (a2 - a1) * scale - mx * s.value * (inverse_b1 - inverse_b2));
  s.d_square = -s.value * inverse_b2;
  s.d_product = two * a1 * scale;
  return s;
}

SPLATBOOST_MATH_END

#endif  // guard

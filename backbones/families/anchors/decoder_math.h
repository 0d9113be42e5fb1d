// SPDX-License-Identifier: Apache-2.0
/// @file Formulas of the anchor decoder outside the nets, shared by all devices (Scaffold-GS, Lu et al. 2024).
#pragma once

#include <cmath>
#include <cstddef>

#include "families/nets/smooth_functions.h"

namespace splatboost {

/// view [4]: direction from the camera to an anchor, and distance.
template <class Real>
SPLATBOOST_SHARED_MATH void view_anchor(const Real* position, const Real* centre, Real* view) {
  const Real x = position[0] - centre[0], y = position[1] - centre[1], z = position[2] - centre[2];
  const Real distance = std::sqrt(x * x + y * y + z * z);
  const Real inverse = distance > 0 ? Real(1) / distance : Real(0);
  view[0] = x * inverse;
  view[1] = y * inverse;
  view[2] = z * inverse;
  view[3] = distance;
}

/// Softmax of three values, in place.
template <class Real>
SPLATBOOST_SHARED_MATH void softmax(Real* w) {
  const Real first = w[0] > w[1] ? w[0] : w[1];
  const Real highest = first > w[2] ? first : w[2];
  for (std::size_t i = 0; i < 3; ++i) w[i] = smooth_exp(w[i] - highest);
  const Real sum = w[0] + w[1] + w[2];
  for (std::size_t i = 0; i < 3; ++i) w[i] /= sum;
}

/// Source channels of channel c of the mixed feature, at coarse and middle resolution; at full resolution it is c.
SPLATBOOST_SHARED_MATH std::size_t coarse_channel(std::size_t c, std::size_t width) { return 4 * (c % (width / 4)); }
SPLATBOOST_SHARED_MATH std::size_t middle_channel(std::size_t c, std::size_t width) { return 2 * (c % (width / 2)); }

/// Channel c of a feature, mixed from three resolutions with the weights w [3].
template <class Real>
SPLATBOOST_SHARED_MATH Real mixed_channel(const Real* feature, const Real* w, std::size_t c, std::size_t width) {
  return w[0] * feature[coarse_channel(c, width)] + w[1] * feature[middle_channel(c, width)] + w[2] * feature[c];
}

/// One coordinate of a slot's mean. @param size of the anchor, the unit of the offset
template <class Real>
SPLATBOOST_SHARED_MATH Real slot_mean(Real position, Real offset, Real size) {
  return position + offset * size;
}
/// One scale of a slot's Gaussian. @param bound of the anchor @param raw output of the net
template <class Real>
SPLATBOOST_SHARED_MATH Real slot_scale(Real bound, Real raw) {
  return bound * sigmoid(raw);
}
/// Gradient with respect to `raw` from that with respect to the log scale; scale / bound is the sigmoid of `raw`.
template <class Real>
SPLATBOOST_SHARED_MATH Real raw_scale_gradient(Real by_log_scale, Real scale, Real bound) {
  return by_log_scale * (1 - scale / bound);
}

/// Gradients with respect to the inputs of tanh and sigmoid. @param value output of the function
template <class Real>
SPLATBOOST_SHARED_MATH Real tanh_gradient(Real given, Real value) {
  return given * (1 - value * value);
}
template <class Real>
SPLATBOOST_SHARED_MATH Real sigmoid_gradient(Real given, Real value) {
  return given * value * (1 - value);
}

}  // namespace splatboost

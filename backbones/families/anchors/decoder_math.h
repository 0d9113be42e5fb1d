// SPDX-License-Identifier: Apache-2.0
/// @file The formulas around the nets that decode anchors, which every device shares (Scaffold-GS, Lu et al. 2024).
#pragma once

#include <cmath>
#include <cstddef>

#include "families/nets/smooth_functions.h"

namespace splatboost {

/// Direction from the camera to an anchor, and the distance: view [4].
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

/// In place, of three values.
template <class Real>
SPLATBOOST_SHARED_MATH void softmax(Real* w) {
  const Real first = w[0] > w[1] ? w[0] : w[1];
  const Real highest = first > w[2] ? first : w[2];
  for (std::size_t i = 0; i < 3; ++i) w[i] = smooth_exp(w[i] - highest);
  const Real sum = w[0] + w[1] + w[2];
  for (std::size_t i = 0; i < 3; ++i) w[i] /= sum;
}

/// The channels of a feature that channel c of the mixed one is made of, coarse and middle; the third is c itself.
SPLATBOOST_SHARED_MATH std::size_t coarse_channel(std::size_t c, std::size_t width) { return 4 * (c % (width / 4)); }
SPLATBOOST_SHARED_MATH std::size_t middle_channel(std::size_t c, std::size_t width) { return 2 * (c % (width / 2)); }

/// Channel c of a feature in the mix of resolutions that the weights w [3] ask for.
template <class Real>
SPLATBOOST_SHARED_MATH Real mixed_channel(const Real* feature, const Real* w, std::size_t c, std::size_t width) {
  return w[0] * feature[coarse_channel(c, width)] + w[1] * feature[middle_channel(c, width)] + w[2] * feature[c];
}

/// One axis of a slot's Gaussian. @param size of the anchor, with which the offset is counted
template <class Real>
SPLATBOOST_SHARED_MATH Real slot_mean(Real position, Real offset, Real size) {
  return position + offset * size;
}
/// @param bound of the anchor @param raw what the net says
template <class Real>
SPLATBOOST_SHARED_MATH Real slot_scale(Real bound, Real raw) {
  return bound * sigmoid(raw);
}
/// Gradient of `raw` from that of the logarithm of the scale: scale / bound is the sigmoid.
template <class Real>
SPLATBOOST_SHARED_MATH Real raw_scale_gradient(Real by_log_scale, Real scale, Real bound) {
  return by_log_scale * (1 - scale / bound);
}

/// Gradients of what went into tanh and sigmoid, from those of what came out.
template <class Real>
SPLATBOOST_SHARED_MATH Real tanh_gradient(Real given, Real value) {
  return given * (1 - value * value);
}
template <class Real>
SPLATBOOST_SHARED_MATH Real sigmoid_gradient(Real given, Real value) {
  return given * value * (1 - value);
}

}  // namespace splatboost

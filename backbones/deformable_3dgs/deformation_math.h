// SPDX-License-Identifier: Apache-2.0
/// @file Deformation of one Gaussian by the outputs of the net, and its gradients. For the host and for kernels.
#pragma once

#include <cmath>
#include <cstddef>

#include "families/nets/shared_math.h"

namespace splatboost {

/// Width of a row of the net's outputs: `motion` columns that move the mean (3: an offset; 6: rotation vector ω and
/// velocity ν of a rigid motion), four that are added to the quaternion, three that are added to the scales.
SPLATBOOST_SHARED_MATH std::size_t delta_width(std::size_t motion) { return motion + 7; }

/// sin θ/θ, (1 − cos θ)/θ², (θ − sin θ)/θ³ and their derivatives with respect to a = θ²: smooth also at θ = 0.
template <class Real>
struct TurnFactors {
  Real value[3], slope[3];
};

template <class Real>
SPLATBOOST_SHARED_MATH void find_turn_factors(Real a, TurnFactors<Real>& f) {
  if (a < Real(1)) {
    // Σ (−a)ⁿ / (2n + 1 + i)!; the eighth term is below 1e-14.
    for (int i = 0; i < 3; ++i) {
      Real term = Real(1) / Real(i == 2 ? 6 : i + 1);
      Real value = 0, slope = 0;
      for (int n = 0; n < 8; ++n) {
        value += term;
        // Derivative of the next term, which has one more power of a.
        const Real next = -term / Real((2 * n + 2 + i) * (2 * n + 3 + i));
        slope += Real(n + 1) * next;
        term = next * a;
      }
      f.value[i] = value;
      f.slope[i] = slope;
    }
    return;
  }
  const Real theta = std::sqrt(a), sine = std::sin(theta), cosine = std::cos(theta);
  f.value[0] = sine / theta;
  f.value[1] = (Real(1) - cosine) / a;
  f.value[2] = (theta - sine) / (a * theta);
  f.slope[0] = (cosine - f.value[0]) / (Real(2) * a);
  f.slope[1] = (f.value[0] - Real(2) * f.value[1]) / (Real(2) * a);
  f.slope[2] = (f.value[1] - Real(3) * f.value[2]) / (Real(2) * a);
}

template <class Real>
SPLATBOOST_SHARED_MATH void cross(const Real* a, const Real* b, Real* product) {
  product[0] = a[1] * b[2] - a[2] * b[1];
  product[1] = a[2] * b[0] - a[0] * b[2];
  product[2] = a[0] * b[1] - a[1] * b[0];
}

template <class Real>
SPLATBOOST_SHARED_MATH Real dot3(const Real* a, const Real* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// The rigid motion exp(ω, ν) of a point: x + A·(ω×x) + B·(ω×(ω×x)) + ν + B·(ω×ν) + C·(ω×(ω×ν)), A, B, C the factors
/// above (Lynch and Park, Modern Robotics, eq. 3.88, without its division by θ).
template <class Real>
SPLATBOOST_SHARED_MATH void move_rigidly(const Real* x, const Real* motion, Real* moved) {
  const Real *w = motion, *v = motion + 3;
  TurnFactors<Real> f;
  find_turn_factors(dot3(w, w), f);
  Real wx[3], wwx[3], wv[3], wwv[3];
  cross(w, x, wx);
  cross(w, wx, wwx);
  cross(w, v, wv);
  cross(w, wv, wwv);
  for (int c = 0; c < 3; ++c) {
    moved[c] = x[c] + f.value[0] * wx[c] + f.value[1] * wwx[c] + v[c] + f.value[1] * wv[c] + f.value[2] * wwv[c];
  }
}

/// @param g gradient with respect to the moved point @param of_x is added to @param of_motion [6] is overwritten
template <class Real>
SPLATBOOST_SHARED_MATH void move_rigidly_backward(const Real* x, const Real* motion, const Real* g, Real* of_x,
                                                  Real* of_motion) {
  const Real *w = motion, *v = motion + 3;
  TurnFactors<Real> f;
  find_turn_factors(dot3(w, w), f);
  Real wx[3], wwx[3], wv[3], wwv[3], gw[3], gww[3];
  cross(w, x, wx);
  cross(w, wx, wwx);
  cross(w, v, wv);
  cross(w, wv, wwv);
  // The gradient of ω×u is g×ω with respect to u, and u×g with respect to ω.
  cross(g, w, gw);
  cross(gw, w, gww);
  Real by_a = f.slope[0] * dot3(g, wx) + f.slope[1] * (dot3(g, wwx) + dot3(g, wv)) + f.slope[2] * dot3(g, wwv);
  by_a *= Real(2);
  Real first[3], second[3];
  for (int c = 0; c < 3; ++c) {
    first[c] = f.value[0] * x[c] + f.value[1] * (v[c] + wx[c]) + f.value[2] * wv[c];  // operand of ω×·
    second[c] = f.value[1] * x[c] + f.value[2] * v[c];                                // operand of ω×(ω×·)
    of_x[c] += g[c] + f.value[0] * gw[c] + f.value[1] * gww[c];
    of_motion[3 + c] = g[c] + f.value[1] * gw[c] + f.value[2] * gww[c];
  }
  // With respect to the outer ω (`first` includes the inner products), and to the inner ω of ω×(ω×second).
  Real outer[3], inner[3];
  cross(first, g, outer);
  cross(second, gw, inner);
  for (int c = 0; c < 3; ++c) of_motion[c] = outer[c] + inner[c] + by_a * w[c];
}

/// The normalised quaternion plus the net's output. The rasterizer normalises the sum.
template <class Real>
SPLATBOOST_SHARED_MATH void turn_quaternion(const Real* q, const Real* delta, Real* turned) {
  const Real length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (int c = 0; c < 4; ++c) turned[c] = q[c] / length + delta[c];
}

/// @param of_q is added to; the gradient with respect to `delta` is g
template <class Real>
SPLATBOOST_SHARED_MATH void turn_quaternion_backward(const Real* q, const Real* g, Real* of_q) {
  const Real length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const Real along = (q[0] * g[0] + q[1] * g[1] + q[2] * g[2] + q[3] * g[3]) / (length * length);
  for (int c = 0; c < 4; ++c) of_q[c] += (g[c] - along * q[c]) / length;
}

/// Pointers to a Gaussian's mean [3], scales [3] and quaternion [4].
template <class Real>
struct GaussianRow {
  Real *mean, *scale, *rotation;
};

/// @param delta [delta_width(motion)]
template <class Real>
SPLATBOOST_SHARED_MATH void move_gaussian(std::size_t motion, GaussianRow<const Real> at, const Real* delta,
                                          GaussianRow<Real> moved) {
  if (motion == 6) {
    move_rigidly(at.mean, delta, moved.mean);
  } else {
    for (int c = 0; c < 3; ++c) moved.mean[c] = at.mean[c] + delta[c];
  }
  turn_quaternion(at.rotation, delta + motion, moved.rotation);
  for (int c = 0; c < 3; ++c) moved.scale[c] = at.scale[c] + delta[motion + 4 + c];
}

/// @param g gradient with respect to `moved` @param of_delta is overwritten @param of_gaussian is added to
template <class Real>
SPLATBOOST_SHARED_MATH void move_gaussian_backward(std::size_t motion, GaussianRow<const Real> at, const Real* delta,
                                                   GaussianRow<const Real> g, Real* of_delta,
                                                   GaussianRow<Real> of_gaussian) {
  if (motion == 6) {
    move_rigidly_backward(at.mean, delta, g.mean, of_gaussian.mean, of_delta);
  } else {
    for (int c = 0; c < 3; ++c) {
      of_delta[c] = g.mean[c];
      of_gaussian.mean[c] += g.mean[c];
    }
  }
  turn_quaternion_backward(at.rotation, g.rotation, of_gaussian.rotation);
  for (int c = 0; c < 4; ++c) of_delta[motion + c] = g.rotation[c];
  for (int c = 0; c < 3; ++c) {
    of_delta[motion + 4 + c] = g.scale[c];
    of_gaussian.scale[c] += g.scale[c];
  }
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file The 3D smoothing filter of Mip-Splatting (Yu et al. 2024, Sec. 5.1): no Gaussian is thinner than what the
/// training views can resolve where it lies.
#pragma once

#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "common/scene.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Standard deviation of each Gaussian's filter, world units: √variance / ν, ν = max over the views that see its mean
/// of focal length / depth. A mean is seen if it lies behind the near plane and projects into the image widened by
/// `margin` of its size on each side. Means that no view sees get the largest filter of those that are seen.
/// @param means [N,3]
/// @param filters [N]
void smoothing_filters(std::span<const float> means, const std::vector<View>& views, double variance, double margin,
                       std::span<float> filters, Threads& threads);

/// A Gaussian convolved with an isotropic one of standard deviation `filter`, its integral unchanged: each variance
/// grows by filter², and the opacity shrinks by √(Π s² / Π (s² + filter²)).
template <class Real>
struct SmoothedGaussian {
  Real scales[3];
  Real opacity;
  Real factor;  ///< of the opacity, in [0,1]
};

template <class Real>
SmoothedGaussian<Real> smooth(const Real* scales, Real opacity, Real filter) {
  SmoothedGaussian<Real> out;
  out.factor = 1;
  for (int c = 0; c < 3; ++c) {
    out.scales[c] = std::sqrt(scales[c] * scales[c] + filter * filter);
    // One ratio at a time: the product of six small numbers would underflow.
    out.factor *= scales[c] / out.scales[c];
  }
  out.opacity = opacity * out.factor;
  return out;
}

/// Adds to the gradients of what went in, given those of what came out.
template <class Real>
void smooth_backward(const Real* scales, Real filter, const SmoothedGaussian<Real>& out, const Real* g_out_scales,
                     Real g_out_opacity, Real* g_scales, Real& g_opacity) {
  for (int c = 0; c < 3; ++c) {
    // ∂s'/∂s = s/s'; ∂ ln factor/∂s = filter² / (s·s'²)
    const Real s = scales[c] > std::numeric_limits<Real>::min() ? scales[c] : std::numeric_limits<Real>::min();
    const Real wide = out.scales[c];
    const Real spread = filter / wide;
    g_scales[c] += g_out_scales[c] * (s / wide) + g_out_opacity * out.opacity * spread * spread / s;
  }
  g_opacity += g_out_opacity * out.factor;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file The 3D smoothing filter (Yu et al. 2024, Sec. 5.1): no Gaussian is thinner than what the training views can
/// resolve where it lies.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "splatboost/array.h"
#include "splatboost/camera.h"
#include "splatboost/device.h"

namespace splatboost {

/// A Gaussian convolved with an isotropic one of standard deviation `filter`, its integral unchanged: each variance
/// grows by filter², and the opacity shrinks by √(Π s² / Π (s² + filter²)).
template <class Real>
struct SmoothedGaussian {
  Real scales[3];
  Real opacity;
  Real factor;  ///< of the opacity, in [0,1]
};

// constexpr, so that kernels may call them too.
template <class Real>
constexpr SmoothedGaussian<Real> smooth(const Real* scales, Real opacity, Real filter) {
  SmoothedGaussian<Real> out{};
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
constexpr void smooth_backward(const Real* scales, Real filter, const SmoothedGaussian<Real>& out,
                               const Real* g_out_scales, Real g_out_opacity, Real* g_scales, Real& g_opacity) {
  for (int c = 0; c < 3; ++c) {
    // ∂s'/∂s = s/s'; ∂ ln factor/∂s = filter² / (s·s'²)
    const Real s = scales[c] > std::numeric_limits<Real>::min() ? scales[c] : std::numeric_limits<Real>::min();
    const Real wide = out.scales[c];
    const Real spread = filter / wide;
    g_scales[c] += g_out_scales[c] * (s / wide) + g_out_opacity * out.opacity * spread * spread / s;
  }
  g_opacity += g_out_opacity * out.factor;
}

/// The filters of Gaussians for these views.
class SmoothingFilters {
 public:
  /// @param margin share of a view's size by which it sees beyond its border
  SmoothingFilters(std::vector<Camera> views, double variance, double margin, Device device);

  /// Standard deviation of each Gaussian's filter, world units: √variance / ν, ν = max over the views that see its mean
  /// of focal length / depth. A mean is seen if it lies behind the near plane and projects into the widened image.
  /// Means that no view sees get the largest filter of those that are seen.
  /// @param means [N,3]
  /// @param filters [N]
  void compute(std::span<const float> means, std::span<float> filters);

 private:
  Device device_;
  Array<Camera> views_;
  float deviation_, margin_;
  Array<std::uint32_t> largest_;  ///< of a GPU: the bits of the largest filter
};

/// Gaussians before and after smooth(). Spans of N rows.
struct SmoothedGaussians {
  std::span<float> scales;     ///< [N,3]
  std::span<float> opacities;  ///< [N]
  std::span<float> factors;    ///< [N] of opacities
};
void smooth_gaussians(std::span<const float> scales, std::span<const float> opacities, std::span<const float> filters,
                      const SmoothedGaussians& smoothed, Device device);

struct SmoothedGradients {
  std::span<const float> scales;     ///< [N,3] with respect to smoothed scales
  std::span<const float> opacities;  ///< [N] ... opacities
};
/// Adds to the gradients of what went in.
void smooth_gaussians_backward(std::span<const float> scales, std::span<const float> filters,
                               const SmoothedGaussians& smoothed, const SmoothedGradients& of_smoothed,
                               std::span<float> scale_gradients, std::span<float> opacity_gradients, Device device);

}  // namespace splatboost

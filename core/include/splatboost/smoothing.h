// SPDX-License-Identifier: Apache-2.0
/// @file The 3D smoothing filter (Yu et al. 2024, Sec. 5.1): no Gaussian is thinner than what the training views can
/// resolve at its mean.
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

/// A Gaussian convolved with an isotropic one of standard deviation `filter`, preserving its integral: each variance
/// grows by filter², and the opacity is multiplied by √(Π s² / Π (s² + filter²)).
template <class Real>
struct SmoothedGaussian {
  Real scales[3];
  Real opacity;
  Real factor;  ///< of the opacity, in [0,1]
};

// constexpr, so that CUDA kernels can call them too.
template <class Real>
constexpr SmoothedGaussian<Real> smooth(const Real* scales, Real opacity, Real filter) {
  SmoothedGaussian<Real> out{};
  out.factor = 1;
  for (int c = 0; c < 3; ++c) {
    out.scales[c] = std::sqrt(scales[c] * scales[c] + filter * filter);
    // Ratio by ratio: the product of six small numbers would underflow.
    out.factor *= scales[c] / out.scales[c];
  }
  out.opacity = opacity * out.factor;
  return out;
}

/// Adds the gradients with respect to the inputs of smooth(), given those with respect to its outputs.
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

/// Computes the filter of each Gaussian from a set of views.
class SmoothingFilters {
 public:
  /// @param variance of the filter in px², at least 0
  /// @param margin share of its size by which a view is widened on every side, at least 0
  SmoothingFilters(std::vector<Camera> views, double variance, double margin, Device device);

  /// Standard deviation of each Gaussian's filter, world units: √variance / ν, ν = max over the views that see its mean
  /// of focal length / depth. A mean is seen if it lies beyond the near plane and projects into the widened image.
  /// Means that no view sees get the largest filter of the others.
  /// @param means [N,3]
  /// @param filters [N]
  void compute(std::span<const float> means, std::span<float> filters);

 private:
  Device device_;
  Array<Camera> views_;
  float deviation_, margin_;
  Array<std::uint32_t> largest_;  ///< on a GPU: bits of the largest filter
};

/// Outputs of smooth() for N Gaussians.
struct SmoothedGaussians {
  std::span<float> scales;     ///< [N,3]
  std::span<float> opacities;  ///< [N]
  std::span<float> factors;    ///< [N] SmoothedGaussian::factor
};
/// @param scales [N,3]
/// @param opacities [N]
/// @param filters [N] as SmoothingFilters::compute() left them
void smooth_gaussians(std::span<const float> scales, std::span<const float> opacities, std::span<const float> filters,
                      const SmoothedGaussians& smoothed, Device device);

struct SmoothedGradients {
  std::span<const float> scales;     ///< [N,3] with respect to smoothed scales
  std::span<const float> opacities;  ///< [N] with respect to smoothed opacities
};
/// Adds the gradients with respect to the inputs.
/// @param smoothed as smooth_gaussians() left it
/// @param scale_gradients [N,3]
/// @param opacity_gradients [N]
void smooth_gaussians_backward(std::span<const float> scales, std::span<const float> filters,
                               const SmoothedGaussians& smoothed, const SmoothedGradients& of_smoothed,
                               std::span<float> scale_gradients, std::span<float> opacity_gradients, Device device);

}  // namespace splatboost

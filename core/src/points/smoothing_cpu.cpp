// SPDX-License-Identifier: Apache-2.0
#include "splatboost/smoothing.h"

#include <algorithm>

#include "points/cuda_ops.h"
#include "points/smoothing_math.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 1024;

void check_smoothed(const SmoothedGaussians& smoothed, std::size_t n) {
  SPLATBOOST_CHECK(smoothed.scales.size() == 3 * n && smoothed.opacities.size() == n && smoothed.factors.size() == n,
                   "smoothed scales, opacities and factors must have N rows");
}

}  // namespace

SmoothingFilters::SmoothingFilters(std::vector<Camera> views, double variance, double margin, Device device)
    : device_(device),
      views_(device, std::move(views)),
      deviation_(static_cast<float>(std::sqrt(variance))),
      margin_(static_cast<float>(margin)),
      largest_(device) {
  SPLATBOOST_CHECK(variance >= 0 && margin >= 0, "variance and margin must not be negative");
  largest_.ensure(1);
}

void SmoothingFilters::compute(std::span<const float> means, std::span<float> filters) {
  SPLATBOOST_CHECK(means.size() == 3 * filters.size(), "means must be [N,3]");
  if (device_.is_cuda()) {
    return cuda::smoothing_filters(means, views_, deviation_, margin_, largest_, filters, device_.stream());
  }
  const std::vector<Camera>& views = views_.host();
  device_.threads().for_range(filters.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const float mean[3] = {means[3 * i], means[3 * i + 1], means[3 * i + 2]};
      float rate = 0;
      for (const Camera& view : views) rate = std::max(rate, sampling_rate(view, mean, margin_));
      filters[i] = rate > 0 ? deviation_ / rate : 0.0f;
    }
  });
  const auto largest = std::max_element(filters.begin(), filters.end());
  if (largest == filters.end()) return;
  const float of_unseen = *largest;
  for (float& filter : filters) {
    if (filter == 0) filter = of_unseen;
  }
}

void smooth_gaussians(std::span<const float> scales, std::span<const float> opacities, std::span<const float> filters,
                      const SmoothedGaussians& smoothed, Device device) {
  const std::size_t n = opacities.size();
  SPLATBOOST_CHECK(scales.size() == 3 * n && filters.size() == n, "scales and filters must have N rows");
  check_smoothed(smoothed, n);
  if (device.is_cuda()) return cuda::smooth_gaussians(scales, opacities, filters, smoothed, device.stream());
  device.threads().for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const SmoothedGaussian<float> out = smooth(&scales[3 * i], opacities[i], filters[i]);
      for (std::size_t c = 0; c < 3; ++c) smoothed.scales[3 * i + c] = out.scales[c];
      smoothed.opacities[i] = out.opacity;
      smoothed.factors[i] = out.factor;
    }
  });
}

void smooth_gaussians_backward(std::span<const float> scales, std::span<const float> filters,
                               const SmoothedGaussians& smoothed, const SmoothedGradients& of_smoothed,
                               std::span<float> scale_gradients, std::span<float> opacity_gradients, Device device) {
  const std::size_t n = filters.size();
  SPLATBOOST_CHECK(scales.size() == 3 * n && of_smoothed.scales.size() == 3 * n && of_smoothed.opacities.size() == n &&
                       scale_gradients.size() == 3 * n && opacity_gradients.size() == n,
                   "scales, filters and gradients must have N rows");
  check_smoothed(smoothed, n);
  if (device.is_cuda()) {
    return cuda::smooth_gaussians_backward(scales, filters, smoothed, of_smoothed, scale_gradients, opacity_gradients,
                                           device.stream());
  }
  device.threads().for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      SmoothedGaussian<float> out;
      for (std::size_t c = 0; c < 3; ++c) out.scales[c] = smoothed.scales[3 * i + c];
      out.opacity = smoothed.opacities[i];
      out.factor = smoothed.factors[i];
      smooth_backward(&scales[3 * i], filters[i], out, &of_smoothed.scales[3 * i], of_smoothed.opacities[i],
                      &scale_gradients[3 * i], opacity_gradients[i]);
    }
  });
}

}  // namespace splatboost

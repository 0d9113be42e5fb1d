// SPDX-License-Identifier: Apache-2.0
#include "splatboost/density_statistics.h"

#include <algorithm>

#include "density/cuda_ops.h"
#include "density/density_statistics_math.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 4096;

void check_sums(const ScreenGradientSums& sums) {
  const std::size_t n = sums.norms.size();
  SPLATBOOST_CHECK(sums.norms_abs.size() == n && sums.views.size() == n, "the sums must have the same size");
}

}  // namespace

void add_screen_gradients(const ScreenGradients& view, AbsoluteNorm norm, float views, const ScreenGradientSums& sums,
                          Device device) {
  check_sums(sums);
  const std::size_t n = sums.norms.size();
  SPLATBOOST_CHECK(view.visible.size() == n && view.screen.size() == 2 * n,
                   "the view must have the same number of Gaussians");
  SPLATBOOST_CHECK(view.screen_abs.empty() || view.screen_abs.size() == 2 * n, "screen_abs must be empty or [N,2]");
  if (device.is_cuda()) return cuda::add_screen_gradients(view, norm, views, sums, device.stream());
  const float to_ndc_x = 0.5f * static_cast<float>(view.width), to_ndc_y = 0.5f * static_cast<float>(view.height);
  const bool absolute = !view.screen_abs.empty();
  device.threads().for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (view.visible[i] == 0) continue;
      sums.norms[i] += length_of(view.screen[2 * i] * to_ndc_x, view.screen[2 * i + 1] * to_ndc_y);
      if (absolute) {
        sums.norms_abs[i] +=
            absolute_norm_of(view.screen_abs[2 * i] * to_ndc_x, view.screen_abs[2 * i + 1] * to_ndc_y, norm);
      }
      sums.views[i] += views;
    }
  });
}

void add_screen_radii(std::span<const std::int32_t> radii, std::span<const std::int32_t> observed,
                      std::span<std::int32_t> largest, Device device) {
  SPLATBOOST_CHECK(radii.size() == largest.size() && observed.size() == largest.size(),
                   "radii and observations must have the same number of Gaussians");
  if (device.is_cuda()) return cuda::add_screen_radii(radii, observed, largest, device.stream());
  for (std::size_t i = 0; i < largest.size(); ++i) {
    if (observed[i] != 0) largest[i] = std::max(largest[i], radii[i]);
  }
}

void mean_screen_gradients(const ScreenGradientSums& sums, std::span<float> means, std::span<float> means_abs,
                           Device device) {
  check_sums(sums);
  const std::size_t n = sums.norms.size();
  SPLATBOOST_CHECK(means.size() == n && means_abs.size() == n, "the means must have the size of the sums");
  if (device.is_cuda()) return cuda::mean_screen_gradients(sums, means, means_abs, device.stream());
  for (std::size_t i = 0; i < n; ++i) {
    means[i] = mean_over_views(sums.norms[i], sums.views[i]);
    means_abs[i] = mean_over_views(sums.norms_abs[i], sums.views[i]);
  }
}

void longest_scales(std::span<const float> scales, std::span<float> longest, Device device) {
  SPLATBOOST_CHECK(scales.size() == 3 * longest.size(), "scales must be [N,3]");
  if (device.is_cuda()) return cuda::longest_scales(scales, longest, device.stream());
  for (std::size_t i = 0; i < longest.size(); ++i) {
    longest[i] = std::max({scales[3 * i], scales[3 * i + 1], scales[3 * i + 2]});
  }
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "density/cuda_ops.h"
#include "density/density_statistics_math.h"
#include "device/device_view.h"
#include "device/launch.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    add_screen_gradients_kernel(DeviceView<const std::uint8_t> visible, DeviceView<const float> screen,
                                DeviceView<const float> screen_abs, float to_ndc_x, float to_ndc_y, AbsoluteNorm norm,
                                float view_count, DeviceView<float> norms, DeviceView<float> norms_abs,
                                DeviceView<float> views) {
  const std::size_t i = element_index();
  if (i >= norms.size() || visible[i] == 0) return;
  norms[i] += length_of(screen[2 * i] * to_ndc_x, screen[2 * i + 1] * to_ndc_y);
  if (!screen_abs.empty()) {
    norms_abs[i] += absolute_norm_of(screen_abs[2 * i] * to_ndc_x, screen_abs[2 * i + 1] * to_ndc_y, norm);
  }
  views[i] += view_count;
}

__global__ void __launch_bounds__(kBlockThreads)
    mean_screen_gradients_kernel(DeviceView<const float> norms, DeviceView<const float> norms_abs,
                                 DeviceView<const float> views, DeviceView<float> means, DeviceView<float> means_abs) {
  const std::size_t i = element_index();
  if (i >= norms.size()) return;
  means[i] = mean_over_views(norms[i], views[i]);
  means_abs[i] = mean_over_views(norms_abs[i], views[i]);
}

__global__ void __launch_bounds__(kBlockThreads)
    longest_scales_kernel(DeviceView<const float> scales, DeviceView<float> longest) {
  const std::size_t i = element_index();
  if (i >= longest.size()) return;
  longest[i] = max_of(scales[3 * i], max_of(scales[3 * i + 1], scales[3 * i + 2]));
}

__global__ void __launch_bounds__(kBlockThreads)
    add_screen_radii_kernel(DeviceView<const std::int32_t> radii, DeviceView<const std::int32_t> observed,
                            DeviceView<std::int32_t> largest) {
  const std::size_t i = element_index();
  if (i >= largest.size() || observed[i] == 0) return;
  largest[i] = max(largest[i], radii[i]);
}

}  // namespace

void add_screen_gradients(const ScreenGradients& view, AbsoluteNorm norm, float views, const ScreenGradientSums& sums,
                          CudaStream& stream) {
  const float to_ndc_x = 0.5f * static_cast<float>(view.width), to_ndc_y = 0.5f * static_cast<float>(view.height);
  launch_each(stream, "add_screen_gradients", add_screen_gradients_kernel, sums.norms.size(), view.visible, view.screen,
              view.screen_abs, to_ndc_x, to_ndc_y, norm, views, sums.norms, sums.norms_abs, sums.views);
}

void add_screen_radii(std::span<const std::int32_t> radii, std::span<const std::int32_t> observed,
                      std::span<std::int32_t> largest, CudaStream& stream) {
  launch_each(stream, "add_screen_radii", add_screen_radii_kernel, largest.size(), radii, observed, largest);
}

void mean_screen_gradients(const ScreenGradientSums& sums, std::span<float> means, std::span<float> means_abs,
                           CudaStream& stream) {
  launch_each(stream, "mean_screen_gradients", mean_screen_gradients_kernel, sums.norms.size(), sums.norms,
              sums.norms_abs, sums.views, means, means_abs);
}

void longest_scales(std::span<const float> scales, std::span<float> longest, CudaStream& stream) {
  launch_each(stream, "longest_scales", longest_scales_kernel, longest.size(), scales, longest);
}

}  // namespace splatboost::cuda

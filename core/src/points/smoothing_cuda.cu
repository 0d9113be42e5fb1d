// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "points/cuda_ops.h"
#include "points/smoothing_math.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    smoothing_filters_kernel(DeviceView<const float> means, DeviceView<const Camera> views, float deviation,
                             float margin, DeviceView<std::uint32_t> largest, DeviceView<float> filters) {
  const std::size_t i = element_index();
  float filter = 0;
  if (i < filters.size()) {
    const float mean[3] = {means[3 * i], means[3 * i + 1], means[3 * i + 2]};
    float rate = 0;
    for (std::size_t v = 0; v < views.size(); ++v) rate = max_of(rate, sampling_rate(views[v], mean, margin));
    filter = rate > 0 ? deviation / rate : 0.0f;
    filters[i] = filter;
  }
  // Non-negative floats have the same order as their bits.
  const std::uint32_t most = warp_max(__float_as_uint(filter));
  if (threadIdx.x % 32 == 0) atomicMax(&largest[0], most);
}

__global__ void __launch_bounds__(kBlockThreads)
    fill_unseen_kernel(DeviceView<const std::uint32_t> largest, DeviceView<float> filters) {
  const std::size_t i = element_index();
  if (i >= filters.size()) return;
  if (filters[i] == 0) filters[i] = __uint_as_float(largest[0]);
}

__global__ void __launch_bounds__(kBlockThreads)
    smooth_kernel(DeviceView<const float> scales, DeviceView<const float> opacities, DeviceView<const float> filters,
                  DeviceView<float> out_scales, DeviceView<float> out_opacities, DeviceView<float> factors) {
  const std::size_t i = element_index();
  if (i >= factors.size()) return;
  const float in[3] = {scales[3 * i], scales[3 * i + 1], scales[3 * i + 2]};
  const SmoothedGaussian<float> out = smooth<float>(in, opacities[i], filters[i]);
  for (std::size_t c = 0; c < 3; ++c) out_scales[3 * i + c] = out.scales[c];
  out_opacities[i] = out.opacity;
  factors[i] = out.factor;
}

__global__ void __launch_bounds__(kBlockThreads)
    smooth_backward_kernel(DeviceView<const float> scales, DeviceView<const float> filters,
                           DeviceView<const float> out_scales, DeviceView<const float> out_opacities,
                           DeviceView<const float> factors, DeviceView<const float> g_out_scales,
                           DeviceView<const float> g_out_opacities, DeviceView<float> g_scales,
                           DeviceView<float> g_opacities) {
  const std::size_t i = element_index();
  if (i >= factors.size()) return;
  SmoothedGaussian<float> out;
  float in[3], g_out[3], g[3];
  for (std::size_t c = 0; c < 3; ++c) {
    in[c] = scales[3 * i + c];
    out.scales[c] = out_scales[3 * i + c];
    g_out[c] = g_out_scales[3 * i + c];
    g[c] = g_scales[3 * i + c];
  }
  out.opacity = out_opacities[i];
  out.factor = factors[i];
  float g_opacity = g_opacities[i];
  smooth_backward<float>(in, filters[i], out, g_out, g_out_opacities[i], g, g_opacity);
  for (std::size_t c = 0; c < 3; ++c) g_scales[3 * i + c] = g[c];
  g_opacities[i] = g_opacity;
}

}  // namespace

void smoothing_filters(std::span<const float> means, std::span<const Camera> views, float deviation, float margin,
                       std::span<std::uint32_t> largest, std::span<float> filters, CudaStream& stream) {
  stream.fill_zero(largest.data(), largest.size_bytes());
  launch_each(stream, "smoothing_filters", smoothing_filters_kernel, filters.size(), means, views, deviation, margin,
              largest, filters);
  launch_each(stream, "fill_unseen", fill_unseen_kernel, filters.size(), std::span<const std::uint32_t>(largest),
              filters);
}

void smooth_gaussians(std::span<const float> scales, std::span<const float> opacities, std::span<const float> filters,
                      const SmoothedGaussians& smoothed, CudaStream& stream) {
  launch_each(stream, "smooth", smooth_kernel, opacities.size(), scales, opacities, filters, smoothed.scales,
              smoothed.opacities, smoothed.factors);
}

void smooth_gaussians_backward(std::span<const float> scales, std::span<const float> filters,
                               const SmoothedGaussians& smoothed, const SmoothedGradients& of_smoothed,
                               std::span<float> scale_gradients, std::span<float> opacity_gradients,
                               CudaStream& stream) {
  launch_each(stream, "smooth_backward", smooth_backward_kernel, filters.size(), scales, filters,
              std::span<const float>(smoothed.scales), std::span<const float>(smoothed.opacities),
              std::span<const float>(smoothed.factors), of_smoothed.scales, of_smoothed.opacities, scale_gradients,
              opacity_gradients);
}

}  // namespace splatboost::cuda

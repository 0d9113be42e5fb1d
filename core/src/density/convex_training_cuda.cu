// SPDX-License-Identifier: Apache-2.0
#include "density/convex_training_math.h"
#include "density/cuda_ops.h"
#include "device/device_view.h"
#include "device/launch.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    mask_opacities_kernel(DeviceView<const float> opacities, DeviceView<const float> masks, DeviceView<float> drawn) {
  const std::size_t i = element_index();
  if (i < drawn.size()) drawn[i] = masked_opacity(opacities[i], masks[i]);
}

__global__ void __launch_bounds__(kBlockThreads)
    mask_opacities_backward_kernel(DeviceView<const float> opacities, DeviceView<const float> masks,
                                   DeviceView<const float> drawn, float mask_slope, DeviceView<float> opacity_gradients,
                                   DeviceView<float> mask_gradients) {
  const std::size_t i = element_index();
  if (i >= opacities.size()) return;
  float opacity_gradient = opacity_gradients[i], mask_gradient = mask_gradients[i];
  add_masked_gradients(opacities[i], masks[i], drawn[i], mask_slope, opacity_gradient, mask_gradient);
  opacity_gradients[i] = opacity_gradient;
  mask_gradients[i] = mask_gradient;
}

__global__ void __launch_bounds__(kBlockThreads)
    add_sharpness_gradients_kernel(DeviceView<const std::uint8_t> visible, DeviceView<const float> gradients,
                                   DeviceView<const float> gradients_abs, DeviceView<float> sums,
                                   DeviceView<float> sums_abs, DeviceView<float> views) {
  const std::size_t i = element_index();
  if (i >= sums.size() || visible[i] == 0) return;
  sums[i] += gradients[i];
  if (!gradients_abs.empty()) sums_abs[i] += gradients_abs[i];
  views[i] += 1.0f;
}

}  // namespace

void mask_opacities(std::span<const float> opacities, std::span<const float> masks, std::span<float> drawn,
                    CudaStream& stream) {
  launch_each(stream, "mask_opacities", mask_opacities_kernel, drawn.size(), opacities, masks, drawn);
}

void mask_opacities_backward(std::span<const float> opacities, std::span<const float> masks,
                             std::span<const float> drawn, float mask_slope, std::span<float> opacity_gradients,
                             std::span<float> mask_gradients, CudaStream& stream) {
  launch_each(stream, "mask_opacities_backward", mask_opacities_backward_kernel, opacities.size(), opacities, masks,
              drawn, mask_slope, opacity_gradients, mask_gradients);
}

void add_sharpness_gradients(std::span<const std::uint8_t> visible, std::span<const float> gradients,
                             std::span<const float> gradients_abs, const SharpnessSums& sums, CudaStream& stream) {
  launch_each(stream, "add_sharpness_gradients", add_sharpness_gradients_kernel, sums.gradients.size(), visible,
              gradients, gradients_abs, sums.gradients, sums.gradients_abs, sums.views);
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/host_device.h"
#include "device/launch.h"
#include "optim/activation_math.h"
#include "optim/cuda_ops.h"

namespace splatboost::cuda {
namespace {

constexpr float kLargestExponent = 88.0f;  // its exponential is still finite

__global__ void __launch_bounds__(kBlockThreads)
    exponentials_kernel(DeviceView<const float> from, DeviceView<float> to) {
  const std::size_t i = element_index();
  if (i >= to.size()) return;
  to[i] = expf(min_of(from[i], kLargestExponent));
}

__global__ void __launch_bounds__(kBlockThreads) sigmoids_kernel(DeviceView<const float> from, DeviceView<float> to) {
  const std::size_t i = element_index();
  if (i >= to.size()) return;
  to[i] = 1.0f / (1.0f + expf(min_of(-from[i], kLargestExponent)));
}

__global__ void __launch_bounds__(kBlockThreads)
    sigmoid_gradients_kernel(DeviceView<const float> sigmoids, DeviceView<float> gradients) {
  const std::size_t i = element_index();
  if (i >= gradients.size()) return;
  gradients[i] *= sigmoid_slope(sigmoids[i]);
}

}  // namespace

void exponentials(std::span<const float> from, std::span<float> to, CudaStream& stream) {
  launch_each(stream, "exponentials", exponentials_kernel, to.size(), from, to);
}

void sigmoids(std::span<const float> from, std::span<float> to, CudaStream& stream) {
  launch_each(stream, "sigmoids", sigmoids_kernel, to.size(), from, to);
}

void sigmoid_gradients(std::span<const float> sigmoids, std::span<float> gradients, CudaStream& stream) {
  launch_each(stream, "sigmoid_gradients", sigmoid_gradients_kernel, gradients.size(), sigmoids, gradients);
}

}  // namespace splatboost::cuda

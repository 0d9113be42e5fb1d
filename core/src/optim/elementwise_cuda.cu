// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/host_device.h"
#include "device/launch.h"
#include "optim/cuda_ops.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads) scale_kernel(DeviceView<float> values, float factor) {
  const std::size_t i = element_index();
  if (i >= values.size()) return;
  values[i] *= factor;
}

__global__ void __launch_bounds__(kBlockThreads)
    multiply_kernel(DeviceView<const float> values, DeviceView<const float> factors, DeviceView<float> products) {
  const std::size_t i = element_index();
  if (i >= values.size()) return;
  products[i] = values[i] * factors[i];
}

__global__ void __launch_bounds__(kBlockThreads)
    add_products_kernel(DeviceView<const float> values, DeviceView<const float> factors, DeviceView<float> sums) {
  const std::size_t i = element_index();
  if (i >= values.size()) return;
  sums[i] += values[i] * factors[i];
}

__global__ void __launch_bounds__(kBlockThreads)
    average_in_kernel(DeviceView<const float> values, float share, DeviceView<float> averages) {
  const std::size_t i = element_index();
  if (i >= values.size()) return;
  averages[i] += share * (values[i] - averages[i]);
}

__global__ void __launch_bounds__(kBlockThreads) clamp_above_kernel(DeviceView<float> values, float bound) {
  const std::size_t i = element_index();
  if (i >= values.size()) return;
  values[i] = min_of(bound, values[i]);  // NaN stays NaN, as on the CPU
}

__global__ void __launch_bounds__(kBlockThreads)
    clear_from_kernel(DeviceView<const float> values, float bound, DeviceView<float> gradients) {
  const std::size_t i = element_index();
  if (i >= values.size()) return;
  if (values[i] >= bound) gradients[i] = 0;
}

}  // namespace

void scale(std::span<float> values, float factor, CudaStream& stream) {
  launch_each(stream, "scale", scale_kernel, values.size(), values, factor);
}

void multiply(std::span<const float> values, std::span<const float> factors, std::span<float> products,
              CudaStream& stream) {
  launch_each(stream, "multiply", multiply_kernel, values.size(), values, factors, products);
}

void add_products(std::span<const float> values, std::span<const float> factors, std::span<float> sums,
                  CudaStream& stream) {
  launch_each(stream, "add_products", add_products_kernel, values.size(), values, factors, sums);
}

void average_in(std::span<const float> values, float share, std::span<float> averages, CudaStream& stream) {
  launch_each(stream, "average_in", average_in_kernel, values.size(), values, share, averages);
}

void clamp_above(std::span<float> values, float bound, CudaStream& stream) {
  launch_each(stream, "clamp_above", clamp_above_kernel, values.size(), values, bound);
}

void clear_from(std::span<const float> values, float bound, std::span<float> gradients, CudaStream& stream) {
  launch_each(stream, "clear_from", clear_from_kernel, values.size(), values, bound, gradients);
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "optim/adam_math.h"
#include "optim/cuda_ops.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    adam_kernel(DeviceView<float> values, DeviceView<float> gradients, DeviceView<float> first,
                DeviceView<float> second, AdamFactors factors) {
  const std::size_t i = element_index();
  if (i >= values.size()) return;
  float value = values[i], m = first[i], v = second[i];
  adam_one(factors, gradients[i], value, m, v);
  values[i] = value;
  first[i] = m;
  second[i] = v;
  gradients[i] = 0.0f;
}

}  // namespace

void adam_step(std::span<float> values, std::span<float> gradients, std::span<float> first_moments,
               std::span<float> second_moments, std::int64_t step, const AdamOptions& options, CudaStream& stream) {
  launch_each(stream, "adam", adam_kernel, values.size(), values, gradients, first_moments, second_moments,
              adam_factors(options, step));
}

}  // namespace splatboost::cuda

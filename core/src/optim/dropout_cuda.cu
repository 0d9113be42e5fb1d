// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "optim/cuda_ops.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    dropout_kernel(RandomStream random, double rate, float kept, DeviceView<float> factors) {
  const std::size_t i = element_index();
  if (i >= factors.size()) return;
  factors[i] = random.uniform(i) < rate ? 0.0f : kept;
}

}  // namespace

void dropout_factors(const RandomStream& random, double rate, float kept, std::span<float> factors,
                     CudaStream& stream) {
  launch_each(stream, "dropout", dropout_kernel, factors.size(), random, rate, kept, factors);
}

}  // namespace splatboost::cuda

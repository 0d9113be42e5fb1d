// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "optim/cuda_ops.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    gather_kernel(DeviceView<const float> from, DeviceView<const std::uint32_t> rows, std::size_t width,
                  DeviceView<float> to) {
  const std::size_t i = element_index();
  if (i >= to.size()) return;
  to[i] = from[rows[i / width] * width + i % width];
}

}  // namespace

void gather_rows(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                 std::span<float> to, CudaStream& stream) {
  launch_each(stream, "gather_rows", gather_kernel, to.size(), from, rows, width, to);
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
#include "density/clearance_math.h"
#include "density/cuda_ops.h"
#include "device/device_view.h"
#include "device/launch.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    camera_clearances_kernel(DeviceView<const float> means, DeviceView<const float> centres,
                             DeviceView<const float> distances, DeviceView<float> clearances) {
  const std::size_t i = element_index();
  if (i >= clearances.size()) return;
  const float x = means[3 * i], y = means[3 * i + 1], z = means[3 * i + 2];
  float least = INFINITY;
  for (std::size_t c = 0; c < distances.size(); ++c) {
    if (!(distances[c] > 0)) continue;
    least = min_of(squared_clearance(x - centres[3 * c], y - centres[3 * c + 1], z - centres[3 * c + 2], distances[c]),
                   least);
  }
  clearances[i] = sqrtf(least);
}

}  // namespace

void camera_clearances(std::span<const float> means, std::span<const float> centres, std::span<const float> distances,
                       std::span<float> clearances, CudaStream& stream) {
  launch_each(stream, "camera_clearances", camera_clearances_kernel, clearances.size(), means, centres, distances,
              clearances);
}

}  // namespace splatboost::cuda

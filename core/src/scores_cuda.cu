// SPDX-License-Identifier: Apache-2.0
#include "cuda_operations.h"
#include "device_view.h"
#include "launch.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    add_view_kernel(DeviceView<const std::int32_t> view_counts, double loss, DeviceView<std::int64_t> counts,
                    DeviceView<double> weighted_counts) {
  const std::size_t i = element_index();
  if (i >= counts.size()) return;
  counts[i] += view_counts[i];
  // Rounded twice, as on the CPU: a fused multiply-add would give other sums, and other decisions.
  weighted_counts[i] = __dadd_rn(weighted_counts[i], __dmul_rn(loss, static_cast<double>(view_counts[i])));
}

}  // namespace

void add_view(std::span<const std::int32_t> view_counts, double photometric_loss, std::span<std::int64_t> counts,
              std::span<double> weighted_counts, CudaStream& stream) {
  launch_each(stream, "add_view", add_view_kernel, counts.size(), view_counts, photometric_loss, counts,
              weighted_counts);
}

}  // namespace splatboost::cuda

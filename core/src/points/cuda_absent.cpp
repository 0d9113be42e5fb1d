// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu files of this folder in a build without CUDA. Never called, because no CudaStream can be created.
#include "device/cuda_absent.h"
#include "points/cuda_ops.h"

namespace splatboost::cuda {

void smoothing_filters(std::span<const float>, std::span<const Camera>, float, float, std::span<std::uint32_t>,
                       std::span<float>, CudaStream&) {
  absent();
}
void smooth_gaussians(std::span<const float>, std::span<const float>, std::span<const float>, const SmoothedGaussians&,
                      CudaStream&) {
  absent();
}
void smooth_gaussians_backward(std::span<const float>, std::span<const float>, const SmoothedGaussians&,
                               const SmoothedGradients&, std::span<float>, std::span<float>, CudaStream&) {
  absent();
}
void spatial_order(std::span<const float>, std::span<std::uint32_t>, CudaStream&) { absent(); }
void mean_squared_neighbor_distances(std::span<const float>, int, std::span<float>, CudaStream&) { absent(); }

}  // namespace splatboost::cuda

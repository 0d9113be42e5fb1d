// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu files of this folder in a build without CUDA. Never called, because no CudaStream can be created.
#include "device/cuda_absent.h"
#include "projection/cuda_ops.h"

namespace splatboost::cuda {

void mark_visible(const Camera&, std::span<const float>, float, std::span<std::uint8_t>, CudaStream&) { absent(); }
void visible_radii(const Camera&, const Gaussians&, const RasterOptions&, std::span<std::int32_t>, CudaStream&) {
  absent();
}

}  // namespace splatboost::cuda

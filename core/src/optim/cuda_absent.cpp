// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu files of this folder in a build without CUDA. There is no stream then, so nothing here is called.
#include "device/cuda_absent.h"
#include "optim/cuda_ops.h"

namespace splatboost::cuda {

void exponentials(std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void sigmoids(std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void sigmoid_gradients(std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void scale(std::span<float>, float, CudaStream&) { absent(); }
void average_in(std::span<const float>, float, std::span<float>, CudaStream&) { absent(); }
void clamp_above(std::span<float>, float, CudaStream&) { absent(); }
void clear_from(std::span<const float>, float, std::span<float>, CudaStream&) { absent(); }
void multiply(std::span<const float>, std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void add_products(std::span<const float>, std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void dropout_factors(const RandomStream&, double, float, std::span<float>, CudaStream&) { absent(); }
void adam_step(std::span<float>, std::span<float>, std::span<float>, std::span<float>, std::int64_t, const AdamOptions&,
               CudaStream&) {
  absent();
}
void gather_rows(std::span<const float>, std::size_t, std::span<const std::uint32_t>, std::span<float>, CudaStream&) {
  absent();
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu files of this folder in a build without CUDA. There is no stream then, so nothing here is called.
#include "device/cuda_absent.h"
#include "density/cuda_ops.h"

namespace splatboost::cuda {

void add_screen_gradients(const ScreenGradients&, AbsoluteNorm, float, const ScreenGradientSums&, CudaStream&) {
  absent();
}
void add_screen_radii(std::span<const std::int32_t>, std::span<const std::int32_t>, std::span<std::int32_t>,
                      CudaStream&) {
  absent();
}
void mean_screen_gradients(const ScreenGradientSums&, std::span<float>, std::span<float>, CudaStream&) { absent(); }
void longest_scales(std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void camera_clearances(std::span<const float>, std::span<const float>, std::span<const float>, std::span<float>,
                       CudaStream&) {
  absent();
}
void add_view(std::span<const std::int32_t>, double, std::span<std::int64_t>, std::span<double>, CudaStream&) {
  absent();
}
void importance_scores(std::span<const std::int64_t>, int, std::span<std::int64_t>, CudaStream&) { absent(); }
void pruning_scores(std::span<const double>, std::span<float>, CudaStream&) { absent(); }
std::size_t keep_important(std::span<const std::int64_t>, double, std::span<std::uint8_t>, CudaStream&) { absent(); }
void keep_weighted_sample(std::span<const float>, std::size_t, const RandomStream&, std::span<std::uint8_t>,
                          CudaStream&) {
  absent();
}
void keep_largest(std::span<const float>, std::size_t, std::span<std::uint8_t>, CudaStream&) { absent(); }
std::size_t spare_one(std::span<const float>, std::span<std::uint8_t>, CudaStream&) { absent(); }
void mask_opacities(std::span<const float>, std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void mask_opacities_backward(std::span<const float>, std::span<const float>, std::span<const float>, float,
                             std::span<float>, std::span<float>, CudaStream&) {
  absent();
}
void add_sharpness_gradients(std::span<const std::uint8_t>, std::span<const float>, std::span<const float>,
                             const SharpnessSums&, CudaStream&) {
  absent();
}

}  // namespace splatboost::cuda

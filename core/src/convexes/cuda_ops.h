// SPDX-License-Identifier: Apache-2.0
/// @file The operations of this folder on a CUDA device, as the public functions call them, which have checked the
/// arguments. Each is defined in the .cu file of its name; a build without CUDA has cuda_absent.cpp in their place.
#pragma once

#include <memory>

#include "convexes/convex_backend.h"
#include "splatboost/convex_training.h"
#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {

std::unique_ptr<ConvexBackend> make_convex_rasterizer(CudaStream& stream);

void mask_opacities(std::span<const float> opacities, std::span<const float> masks, std::span<float> drawn,
                    CudaStream& stream);
void mask_opacities_backward(std::span<const float> opacities, std::span<const float> masks,
                             std::span<const float> drawn, float mask_slope, std::span<float> opacity_gradients,
                             std::span<float> mask_gradients, CudaStream& stream);
void add_sharpness_gradients(std::span<const std::uint8_t> visible, std::span<const float> gradients,
                             std::span<const float> gradients_abs, const SharpnessSums& sums, CudaStream& stream);

}  // namespace splatboost::cuda

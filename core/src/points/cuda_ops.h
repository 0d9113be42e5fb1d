// SPDX-License-Identifier: Apache-2.0
/// @file CUDA implementations of this folder's operations. The public functions check the arguments before they call
/// them. Each is defined in the .cu file of its name; a build without CUDA uses cuda_absent.cpp instead.
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/smoothing.h"

namespace splatboost::cuda {

/// As in smoothing.h. @param largest [1] workspace
void smoothing_filters(std::span<const float> means, std::span<const Camera> views, float deviation, float margin,
                       std::span<std::uint32_t> largest, std::span<float> filters, CudaStream& stream);
void smooth_gaussians(std::span<const float> scales, std::span<const float> opacities, std::span<const float> filters,
                      const SmoothedGaussians& smoothed, CudaStream& stream);
void smooth_gaussians_backward(std::span<const float> scales, std::span<const float> filters,
                               const SmoothedGaussians& smoothed, const SmoothedGradients& of_smoothed,
                               std::span<float> scale_gradients, std::span<float> opacity_gradients,
                               CudaStream& stream);

void spatial_order(std::span<const float> means, std::span<std::uint32_t> order, CudaStream& stream);

inline constexpr int kMaxNeighbors = 8;  ///< a thread keeps their distances in an array
void mean_squared_neighbor_distances(std::span<const float> points, int k, std::span<float> mean_squared_distances,
                                     CudaStream& stream);

}  // namespace splatboost::cuda

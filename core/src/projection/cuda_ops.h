// SPDX-License-Identifier: Apache-2.0
/// @file CUDA implementations of this folder's operations. The public functions check the arguments before they call
/// them. Each is defined in the .cu file of its name; a build without CUDA uses cuda_absent.cpp instead.
#pragma once

#include <cstdint>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/gaussians.h"
#include "splatboost/rasterizer.h"

namespace splatboost::cuda {

/// As in visibility.h.
void mark_visible(const Camera& camera, std::span<const float> means, float near_plane, std::span<std::uint8_t> visible,
                  CudaStream& stream);
void visible_radii(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
                   std::span<std::int32_t> radii, CudaStream& stream);

}  // namespace splatboost::cuda

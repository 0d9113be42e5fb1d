// SPDX-License-Identifier: Apache-2.0
/// @file The operations of this folder on a CUDA device, as the public functions call them, which have checked the
/// arguments. Each is defined in the .cu file of its name; a build without CUDA has cuda_absent.cpp in their place.
#pragma once

#include <memory>

#include "convexes/convex_backend.h"
#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {

std::unique_ptr<ConvexBackend> make_convex_rasterizer(CudaStream& stream);

}  // namespace splatboost::cuda

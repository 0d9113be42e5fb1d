// SPDX-License-Identifier: Apache-2.0
/// @file CUDA implementations of this folder's operations, called by the public functions, which check the arguments.
/// Each is defined in the .cu file of its name; a build without CUDA compiles cuda_absent.cpp instead.
#pragma once

#include <memory>

#include "rasterizer/rasterizer_backend.h"
#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {

std::unique_ptr<RasterizerBackend> make_rasterizer(CudaStream& stream);

}  // namespace splatboost::cuda

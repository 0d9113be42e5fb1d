// SPDX-License-Identifier: Apache-2.0
// Stands in for the .cu files of this folder in a build without CUDA. There is no stream, so none of it is ever called.
#include "device/cuda_absent.h"
#include "convexes/cuda_ops.h"

namespace splatboost::cuda {

std::unique_ptr<ConvexBackend> make_convex_rasterizer(CudaStream&) { absent(); }

}  // namespace splatboost::cuda

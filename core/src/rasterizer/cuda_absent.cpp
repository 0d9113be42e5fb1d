// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu files of this folder in a build without CUDA. There is no stream then, so nothing here is called.
#include "device/cuda_absent.h"
#include "rasterizer/cuda_ops.h"

namespace splatboost::cuda {

std::unique_ptr<RasterizerBackend> make_rasterizer(CudaStream&) { absent(); }

}  // namespace splatboost::cuda

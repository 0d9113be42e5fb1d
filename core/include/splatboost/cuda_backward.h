// SPDX-License-Identifier: Apache-2.0
/// @file How a GPU computes the gradient of blending. Which method is faster depends on the GPU and the scene.
#pragma once

namespace splatboost {

enum class CudaBackward {
  per_pixel,  ///< one thread per pixel; each warp sums over its pixels and adds to each splat once
  per_splat,  ///< one thread per splat of a tile; forward() stores pixel states every 32 splats: more memory
};

/// Sets the method for all rasterizers of the process, from their next forward() on. The default is per_pixel.
void use_cuda_backward(CudaBackward way);
CudaBackward cuda_backward();

}  // namespace splatboost

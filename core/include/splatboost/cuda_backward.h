// SPDX-License-Identifier: Apache-2.0
/// @file How a GPU takes the gradient of blending. Which of the two ways is faster depends on the GPU and the scene.
#pragma once

namespace splatboost {

enum class CudaBackward {
  per_pixel,  ///< a thread a pixel; a warp's sums are added to each splat at once
  per_splat,  ///< a thread a splat of a tile, from states that forward() keeps for every 32 of them: more memory
};

/// Holds every rasterizer to this way from its next forward() on, in the whole process. The default is per_pixel.
void use_cuda_backward(CudaBackward way);
CudaBackward cuda_backward();

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu file in builds without CUDA or the cuBLAS header. Never reached: the constructor of AnchorView
// throws first.
#include "octree_gs/usable_anchors.h"
#include "splatboost/errors.h"

namespace splatboost::cuda {

void usable_anchors(const LevelsInUse&, std::span<const float>, std::span<const float>, std::span<const float>,
                    std::span<std::uint8_t>, CudaStream&) {
  throw NoDeviceError("this build of SplatBoost cannot train anchors on a GPU");
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
// What a build without CUDA has in place of the .cu file: AnchorView refused the GPU before.
#include "octree_gs/usable_anchors.h"
#include "splatboost/errors.h"

namespace splatboost::cuda {

void usable_anchors(const LevelsInUse&, std::span<const float>, std::span<const float>, std::span<const float>,
                    std::span<std::uint8_t>, CudaStream&) {
  throw NoDeviceError("this build of SplatBoost has no CUDA");
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
// What a build without CUDA has in place of the .cu file, or one without the nets of anchors: AnchorView refused the
// GPU before.
#include "octree_gs/usable_anchors.h"
#include "splatboost/errors.h"

namespace splatboost::cuda {

void usable_anchors(const LevelsInUse&, std::span<const float>, std::span<const float>, std::span<const float>,
                    std::span<std::uint8_t>, CudaStream&) {
  throw NoDeviceError("this build of SplatBoost trains no anchors on a GPU");
}

}  // namespace splatboost::cuda

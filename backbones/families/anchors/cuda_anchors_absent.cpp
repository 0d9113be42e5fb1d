// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu files in builds without nvcc or the cuBLAS header. make_anchor_view() throws first, so the other
// functions are never reached.
#include "families/anchors/cuda_anchors.h"
#include "splatboost/errors.h"

namespace splatboost::cuda {
namespace {
[[noreturn]] void absent() {
  throw NoDeviceError(
      "this build of SplatBoost cannot train anchors on a GPU; rebuild it with nvcc and cuBLAS installed");
}
}  // namespace

std::unique_ptr<AnchorView::Work> make_anchor_view(const DecoderShape&, CudaStream&) { absent(); }
void add_anchor_opacities(std::span<const std::uint32_t>, std::span<const float>, std::span<float>, std::span<float>,
                          CudaStream&) {
  absent();
}
void add_slot_gradients(std::span<const std::uint32_t>, std::span<const std::uint8_t>, std::span<const float>, float,
                        float, std::span<float>, std::span<float>, CudaStream&) {
  absent();
}
void add_slot_counts(std::span<const std::uint32_t>, std::span<const std::int32_t>, std::span<std::int32_t>,
                     CudaStream&) {
  absent();
}

}  // namespace splatboost::cuda

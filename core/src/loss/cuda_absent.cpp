// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu files of this folder in a build without CUDA. There is no stream then, so nothing here is called.
#include "device/cuda_absent.h"
#include "loss/cuda_ops.h"

namespace splatboost::cuda {

struct PendingLosses::State {};
PendingLosses::PendingLosses(CudaStream&) { absent(); }
PendingLosses::~PendingLosses() = default;
bool PendingLosses::is_full() const { absent(); }
void PendingLosses::send(const DeviceArray<double>&, float) { absent(); }
std::optional<LossTotals> PendingLosses::take() { absent(); }
LossTotals PendingLosses::wait() { absent(); }
void photometric(std::span<const float>, const TruthImage&, float, std::span<float>, PhotometricWorkspace&,
                 CudaStream&) {
  absent();
}
ErrorCounts flag_errors(std::span<const float>, const TruthImage&, float, std::span<float>, std::span<std::uint8_t>,
                        CudaStream&) {
  absent();
}
void ssim(const SsimPlanes&, std::span<const float>, std::span<const float>, int, std::span<float>, std::span<double>,
          CudaSsimWorkspace&) {
  absent();
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
/// @file The operations of this folder on a CUDA device, as the public functions call them, which have checked the
/// arguments. Each is defined in the .cu file of its name; a build without CUDA has cuda_absent.cpp in their place.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {

/// Copies host memory to the device through pinned buffers, so that the host can go on.
class PinnedUploads {
 public:
  explicit PinnedUploads(CudaStream& stream);
  ~PinnedUploads();
  /// The two parts, one behind the other; what they are of may change as soon as this returns. Waits only if the device
  /// has not come to the upload before the last.
  void upload(std::span<const std::uint8_t> first, std::span<const std::uint8_t> second, std::uint8_t* to);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost::cuda

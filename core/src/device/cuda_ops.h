// SPDX-License-Identifier: Apache-2.0
/// @file CUDA implementations of this folder's operations. The public functions check the arguments before they call
/// them. Each is defined in the .cu file of its name; a build without CUDA uses cuda_absent.cpp instead.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {

/// Copies host memory to the device asynchronously, through two pinned buffers.
class PinnedUploads {
 public:
  explicit PinnedUploads(CudaStream& stream);
  ~PinnedUploads();
  /// Copies `first` and then `second` to contiguous memory at `to`. The sources may change as soon as this returns.
  /// Waits only if the device has not finished the upload before the previous one, whose buffer is reused.
  void upload(std::span<const std::uint8_t> first, std::span<const std::uint8_t> second, std::uint8_t* to);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost::cuda

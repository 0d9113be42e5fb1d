// SPDX-License-Identifier: Apache-2.0
/// @file Where an operation runs: on the threads of a CPU, or on a stream of a CUDA device.
#pragma once

#include "splatboost/errors.h"
#include "splatboost/threads.h"

namespace splatboost {

class CudaStream;

/// Threads, or a reference to a stream, which must outlive it and the objects made with it. Spans passed to an
/// operation are in the memory of its device: the host never reads or writes those of a CUDA operation. A CUDA
/// operation returns before it is done; later work on the same stream sees its results.
///
/// Functions may be called from any thread. An object that is made with a device (Rasterizer, Photometric,
/// MultiViewScorer, adapters …) owns a workspace: one thread uses it at a time. So does a CudaStream.
class Device {
 public:
  Device(const Threads& threads) : threads_(threads) {}          // NOLINT: threads are a device
  Device(CudaStream& stream) : threads_(1), stream_(&stream) {}  // NOLINT

  bool is_cuda() const { return stream_ != nullptr; }
  /// Throws ArgumentError on a CUDA device: the operation has no CUDA implementation.
  const Threads& threads() const {
    SPLATBOOST_CHECK(stream_ == nullptr, "this operation runs on the CPU only");
    return threads_;
  }
  CudaStream& stream() const {
    SPLATBOOST_CHECK(stream_ != nullptr, "this is not a CUDA device");
    return *stream_;
  }

 private:
  Threads threads_;
  CudaStream* stream_ = nullptr;
};

}  // namespace splatboost

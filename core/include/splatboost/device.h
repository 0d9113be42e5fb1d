// SPDX-License-Identifier: Apache-2.0
/// @file Where an operation runs: on the threads of a CPU, or on a stream of a CUDA device.
#pragma once

#include "splatboost/errors.h"
#include "splatboost/threads.h"

namespace splatboost {

class CudaStream;

/// A view of threads or of a stream, which must outlive it. The spans that an operation gets are of memory of its
/// device: those of a CUDA operation are never read or written by the host. A CUDA operation returns before it is done;
/// what comes after it on the same stream sees its results.
class Device {
 public:
  Device(Threads& threads) : threads_(&threads) {}  // NOLINT: threads are a device
  Device(CudaStream& stream) : stream_(&stream) {}  // NOLINT

  bool is_cuda() const { return stream_ != nullptr; }
  /// Throws ArgumentError on a CUDA device: what asks for threads has no CUDA implementation.
  Threads& threads() const {
    SPLATBOOST_CHECK(threads_ != nullptr, "this operation runs on the CPU only");
    return *threads_;
  }
  CudaStream& stream() const {
    SPLATBOOST_CHECK(stream_ != nullptr, "this is not a CUDA device");
    return *stream_;
  }

 private:
  Threads* threads_ = nullptr;
  CudaStream* stream_ = nullptr;
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file A CUDA event: a point in a stream. For .cu files.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>

#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {

/// Owns a cudaEvent_t.
class Event {
 public:
  /// @param flags cudaEventDefault, which seconds_between() needs, or cudaEventDisableTiming
  Event(CudaStream& stream, unsigned flags) : stream_(stream) {
    stream.make_current();  // the event belongs to the current device
    stream.check(cudaEventCreateWithFlags(&event_, flags), "cudaEventCreate");
  }
  ~Event() { static_cast<void>(cudaEventDestroy(event_)); }
  Event(const Event&) = delete;
  Event& operator=(const Event&) = delete;

  void record() {
    stream_.make_current();  // a null handle means the default stream of the current device
    stream_.check(cudaEventRecord(event_, static_cast<cudaStream_t>(stream_.handle())), "cudaEventRecord");
    launches_before_ = stream_.launches();
    recorded_ = true;
  }
  bool is_recorded() const { return recorded_; }
  /// Whether the stream has reached the event; true if it was never recorded.
  bool is_done() const {
    const cudaError_t state = cudaEventQuery(event_);
    if (state == cudaErrorNotReady) return false;
    stream_.check(state, "querying the device's progress");
    return true;
  }
  void wait() {
    stream_.check(cudaEventSynchronize(event_), "waiting for the device");
    stream_.count_synchronization(launches_before_);  // later kernels may still fail
  }
  /// Seconds between two events that are done; 0 if one was never recorded.
  friend double seconds_between(const Event& from, const Event& to) {
    if (!from.recorded_ || !to.recorded_) return 0.0;
    float milliseconds = 0;
    to.stream_.check(cudaEventElapsedTime(&milliseconds, from.event_, to.event_), "cudaEventElapsedTime");
    return 1e-3 * static_cast<double>(milliseconds);
  }

 private:
  CudaStream& stream_;
  cudaEvent_t event_ = nullptr;
  bool recorded_ = false;
  std::size_t launches_before_ = 0;  ///< number of kernels launched before the last record()
};

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
/// @file What --device and --threads choose: where the program computes.
#pragma once

#include <memory>
#include <string>

#include "splatboost/cuda_stream.h"
#include "splatboost/device.h"
#include "splatboost/threads.h"

namespace splatboost::program {

/// Throws UsageError unless it is one of "cpu", "cuda" and "cuda:N".
void check_device_name(const std::string& name);
/// Throws UsageError unless so many threads can be asked for.
void check_threads(int threads);

/// Owns the threads and, on a GPU, the stream. Backbones keep references: it outlives them.
class ChosenDevice {
 public:
  /// @param name cpu; cuda, the first GPU; cuda:N, the N-th from 0. Throws InputError in one line where the machine has
  /// no such GPU or the build no CUDA.
  /// @param threads for what the CPU does, on a GPU too; 0: available_cpus()
  ChosenDevice(const std::string& name, int threads);

  Device device() { return stream_ ? Device(*stream_) : Device(threads_); }
  Threads& threads() { return threads_; }
  /// "cpu", or the name of the GPU.
  std::string name() const { return stream_ ? stream_->device_name() : "cpu"; }

 private:
  Threads threads_;
  std::unique_ptr<CudaStream> stream_;
};

}  // namespace splatboost::program

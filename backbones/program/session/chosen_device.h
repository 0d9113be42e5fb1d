// SPDX-License-Identifier: Apache-2.0
/// @file The device and threads chosen by --device and --threads.
#pragma once

#include <memory>
#include <string>

#include "splatboost/cuda_stream.h"
#include "splatboost/device.h"
#include "splatboost/threads.h"

namespace splatboost::program {

inline constexpr char kDeviceRule[] = "must be cpu, cuda or cuda:N";
/// Whether it is one of these.
bool is_device_name(const std::string& name);
/// Throws UsageError unless it is.
void check_device_name(const std::string& name);
/// "must be 0 to …"
std::string threads_rule();
bool is_thread_count(int threads);
/// Throws UsageError unless it is one.
void check_threads(int threads);

/// Owns the threads and, on a GPU, the stream. Must outlive the backbones, which keep references to them.
class ChosenDevice {
 public:
  /// @param name cpu; cuda, the first GPU; cuda:N, the N-th, counted from 0. Throws InputError if the machine has no
  /// such GPU or the build no CUDA.
  /// @param threads for the work of the CPU, also when the device is a GPU, and for OpenCV's loops; 0: available_cpus()
  ChosenDevice(const std::string& name, int threads);

  Device device() { return stream_ ? Device(*stream_) : Device(threads_); }
  const Threads& threads() { return threads_; }
  /// "cpu", or the name of the GPU.
  std::string name() const { return stream_ ? stream_->device_name() : "cpu"; }

 private:
  Threads threads_;
  std::unique_ptr<CudaStream> stream_;
};

}  // namespace splatboost::program

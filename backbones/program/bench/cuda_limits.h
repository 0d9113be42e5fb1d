// SPDX-License-Identifier: Apache-2.0
/// @file Properties of a CUDA device, and its peak rates.
#pragma once

#include <cstddef>
#include <string>

#include "program/bench/machine_limits.h"
#include "splatboost/cuda_stream.h"

namespace splatboost::program {

struct CudaDeviceFacts {
  std::string name;
  std::string compute_capability;  ///< as "9.0"
  std::string driver;              ///< newest CUDA version that the driver supports, as "13.0"
  std::string runtime;             ///< CUDA version that this program was built with
  std::size_t memory_bytes = 0;
};
CudaDeviceFacts cuda_device_facts(const CudaStream& stream);

/// The size of a probe: enough to keep a large device busy for a while.
struct CudaProbe {
  std::size_t copied_bytes = std::size_t{512} << 20;  ///< larger than any cache
  std::size_t threads = std::size_t{1} << 21;
  int rounds = 64;  ///< of eight chains of 16 multiply-adds per thread
};
/// The best of a few runs: a copy, counted as read and written; single-precision multiply-adds, two operations each.
MachineLimits measure_limits(CudaStream& stream, const CudaProbe& probe = {});

}  // namespace splatboost::program

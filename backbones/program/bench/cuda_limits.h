// SPDX-License-Identifier: Apache-2.0
/// @file What a CUDA device is, and what it can do at most.
#pragma once

#include <cstddef>
#include <string>

#include "program/bench/machine_limits.h"
#include "splatboost/cuda_stream.h"

namespace splatboost::program {

struct CudaDeviceFacts {
  std::string name;
  std::string compute_capability;  ///< as "9.0"
  std::string driver;              ///< the newest CUDA that the driver runs, as "13.0"
  std::string runtime;             ///< the CUDA that this program was built with
  std::size_t memory_bytes = 0;
};
CudaDeviceFacts cuda_device_facts(const CudaStream& stream);

/// How much a probe does: enough to fill a large device for a while.
struct CudaProbe {
  std::size_t copied_bytes = std::size_t{512} << 20;  ///< beyond any cache
  std::size_t threads = std::size_t{1} << 21;
  int rounds = 64;  ///< of eight chains of 16 multiply-adds a thread
};
/// The best of a few runs: a copy, counted as read and written; single-precision multiply-adds, two operations each.
MachineLimits measure_limits(CudaStream& stream, const CudaProbe& probe = {});

}  // namespace splatboost::program

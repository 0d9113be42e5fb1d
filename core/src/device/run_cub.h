// SPDX-License-Identifier: Apache-2.0
/// @file Calls of CUB's device-wide functions. For .cu files.
#pragma once

#include <cub/cub.cuh>

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "splatboost/device_array.h"

namespace splatboost::cuda {

/// Calls a CUB function by call(memory, bytes), twice: to query the size of its scratch memory, and to run it.
template <class Call>
void run_cub(CudaStream& stream, DeviceArray<std::uint8_t>& scratch, const char* name, Call&& call) {
  std::size_t bytes = 0;
  static_cast<void>(cudaGetLastError());  // CUB also reports errors of earlier calls, of this thread, that were handled
  stream.begin_launch(name);
  stream.end_launch(call(nullptr, bytes));
  scratch.ensure(std::max<std::size_t>(bytes, 1));
  stream.end_launch(call(scratch.data(), bytes));
}

inline cudaStream_t handle_of(const CudaStream& stream) { return static_cast<cudaStream_t>(stream.handle()); }

/// A sum that stays at 2^32 - 1 instead of wrapping around. It is associative, as CUB requires.
struct SaturatedSum {
  __host__ __device__ std::uint32_t operator()(std::uint32_t a, std::uint32_t b) const {
    const std::uint32_t sum = a + b;
    return sum < a ? 0xffffffffu : sum;
  }
};

/// Replaces each of the counts by the saturated sum of those before it.
inline void sum_to_offsets(CudaStream& stream, DeviceArray<std::uint8_t>& scratch, const char* name,
                           DeviceArray<std::uint32_t>& counts, int n) {
  run_cub(stream, scratch, name, [&](void* memory, std::size_t& bytes) {
    return cub::DeviceScan::ExclusiveScan(memory, bytes, counts.data(), counts.data(), SaturatedSum{}, 0u, n,
                                          handle_of(stream));
  });
}

}  // namespace splatboost::cuda

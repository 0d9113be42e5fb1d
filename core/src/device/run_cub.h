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
  stream.begin_launch(name);
  stream.end_launch(call(nullptr, bytes));
  scratch.ensure(std::max<std::size_t>(bytes, 1));
  stream.end_launch(call(scratch.data(), bytes));
}

inline cudaStream_t handle_of(const CudaStream& stream) { return static_cast<cudaStream_t>(stream.handle()); }

}  // namespace splatboost::cuda

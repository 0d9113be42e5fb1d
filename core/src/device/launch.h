// SPDX-License-Identifier: Apache-2.0
/// @file Launches of kernels with a name, so that error messages can name them. For .cu files.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>
#include <utility>

#include "splatboost/cuda_stream.h"

namespace splatboost {

/// Threads per block of kernels with one thread per element.
inline constexpr std::uint32_t kBlockThreads = 256;

/// Launches kernel(arguments …). Does nothing if there are no blocks.
template <class... Parameters, class... Arguments>
void launch(CudaStream& stream, const char* name, void (*kernel)(Parameters...), dim3 blocks, dim3 threads,
            Arguments&&... arguments) {
  if (blocks.x == 0 || blocks.y == 0 || blocks.z == 0) return;
  stream.begin_launch(name);
  cudaLaunchConfig_t shape{};
  shape.gridDim = blocks;
  shape.blockDim = threads;
  shape.stream = static_cast<cudaStream_t>(stream.handle());
  stream.end_launch(cudaLaunchKernelEx(&shape, kernel, std::forward<Arguments>(arguments)...));
}

/// Launches one thread per element. The kernel calls element_index() and must return if the index is n or above.
template <class... Parameters, class... Arguments>
void launch_each(CudaStream& stream, const char* name, void (*kernel)(Parameters...), std::size_t n,
                 Arguments&&... arguments) {
  const auto blocks = static_cast<std::uint32_t>((n + kBlockThreads - 1) / kBlockThreads);
  launch(stream, name, kernel, dim3(blocks), dim3(kBlockThreads), std::forward<Arguments>(arguments)...);
}

__device__ inline std::size_t element_index() {
  return static_cast<std::size_t>(blockIdx.x) * kBlockThreads + threadIdx.x;
}

inline constexpr unsigned kWholeWarp = 0xffffffffu;

/// Sum over the 32 lanes of a warp. All lanes must call it; all get the result.
template <class T>
__device__ T warp_sum(T value) {
  for (int step = 16; step > 0; step /= 2) value += __shfl_xor_sync(kWholeWarp, value, step);
  return value;
}

/// Counts the lanes for which `holds` is true, with one atomic per warp. All lanes must call it.
__device__ inline void count_lanes(bool holds, unsigned* into) {
  const unsigned lanes = __ballot_sync(kWholeWarp, holds);
  if (threadIdx.x % 32 == 0 && lanes != 0) atomicAdd(into, static_cast<unsigned>(__popc(lanes)));
}

/// Adds the first 2·kHalf values of pairs of lanes that are kDistance apart, then those of pairs at half the distance.
/// Each lane keeps one half of the sums: the upper one if bit kDistance of its number is set.
template <int kHalf, int kDistance, int N>
__device__ void fold(float (&values)[N]) {
  const bool upper = (threadIdx.x & kDistance) != 0;
#pragma unroll
  for (int i = 0; i < kHalf; ++i) {
    const float given = upper ? values[i] : values[i + kHalf];
    const float kept = upper ? values[i + kHalf] : values[i];
    values[i] = kept + __shfl_xor_sync(kWholeWarp, given, kDistance);
  }
  if constexpr (kHalf > 1) fold<kHalf / 2, kDistance / 2>(values);
}

/// Sums of N values over the 32 lanes of a warp, in 31 shuffles (16 for 16 values) instead of 5·N. All lanes must call
/// it; lane l gets the sum of value l·N/32. N is a power of two up to 32. The values are overwritten.
template <int N>
__device__ float warp_sums(float (&values)[N]) {
  static_assert(N > 1 && N <= 32 && (N & (N - 1)) == 0);
  fold<N / 2, 16>(values);
  float sum = values[0];
  for (int step = 16 / N; step > 0; step /= 2) sum += __shfl_xor_sync(kWholeWarp, sum, step);
  return sum;
}

/// Maximum over the 32 lanes of a warp. All lanes must call it; all get the result.
__device__ inline std::uint32_t warp_max(std::uint32_t value) {
  for (int step = 16; step > 0; step /= 2) {
    const std::uint32_t other = __shfl_xor_sync(kWholeWarp, value, step);
    value = other > value ? other : value;
  }
  return value;
}

}  // namespace splatboost

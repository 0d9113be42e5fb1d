// SPDX-License-Identifier: Apache-2.0
/// @file Sums of blending weights that threads share. They stop at the largest number instead of wrapping around, which
/// does not depend on the order of the additions, because no weight is negative.
#pragma once

#include <cstdint>

#include "device/host_device.h"

#if !defined(__CUDACC__) && !defined(SPLATBOOST_CUDA_ON_CPU)
#include <atomic>
#endif

namespace splatboost {

SPLATBOOST_HOST_DEVICE constexpr std::int32_t saturated_sum(std::int32_t sum, std::int32_t weight) {
  constexpr std::int32_t kMost = 0x7fffffff;
  return sum > kMost - weight ? kMost : sum + weight;
}

#if defined(__CUDACC__) || defined(SPLATBOOST_CUDA_ON_CPU)

__device__ inline void add_weight(std::int32_t& sum, std::int32_t weight) {
  std::int32_t expected = 0;
  while (true) {
    const std::int32_t found = atomicCAS(&sum, expected, saturated_sum(expected, weight));
    if (found == expected) return;
    expected = found;
  }
}

#else

inline void add_weight(std::int32_t& sum, std::int32_t weight) {
  const std::atomic_ref<std::int32_t> shared(sum);
  std::int32_t expected = shared.load(std::memory_order_relaxed);
  while (!shared.compare_exchange_weak(expected, saturated_sum(expected, weight), std::memory_order_relaxed)) {
  }
}

#endif

}  // namespace splatboost

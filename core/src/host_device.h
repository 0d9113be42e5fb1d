// SPDX-License-Identifier: Apache-2.0
/// @file Marks the inline formulas that CPU and CUDA share.
#pragma once

#ifdef __CUDACC__
#define SPLATBOOST_HOST_DEVICE __host__ __device__ inline
#else
// Always inlined, so that a caller compiled for a wider instruction set gets the formula in that set.
#define SPLATBOOST_HOST_DEVICE inline __attribute__((always_inline))
#endif

namespace splatboost {

/// Minimum and maximum that compile to one instruction (std::fmin must honour NaN on either side): a NaN in `a` yields
/// b.
SPLATBOOST_HOST_DEVICE constexpr float min_of(float a, float b) { return a < b ? a : b; }
SPLATBOOST_HOST_DEVICE constexpr float max_of(float a, float b) { return a > b ? a : b; }

}  // namespace splatboost

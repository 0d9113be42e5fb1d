// SPDX-License-Identifier: Apache-2.0
/// @file Formulas that every device shares are templates over a number: `float` on a GPU and in plain loops, a vector
/// of floats on a CPU (lanes-inl.h). This header marks them and gives `float` the functions that both need.
#pragma once

#include <cmath>

// The tests' emulator compiles .cu files with the host's compiler, and takes the same branch as nvcc.
#if defined(__CUDACC__) || defined(SPLATBOOST_CUDA_ON_CPU)
#include <cuda_runtime.h>
#define SPLATBOOST_HOST_DEVICE __host__ __device__ inline
// Formulas live in one namespace ...
#define SPLATBOOST_MATH_BEGIN namespace splatboost {
#define SPLATBOOST_MATH_END }
#else
// Always inlined, so that a caller compiled for a wider instruction set gets the formula in that set.
#define SPLATBOOST_HOST_DEVICE inline __attribute__((always_inline))
// ... or in one for each instruction set, which they are compiled for.
#define SPLATBOOST_MATH_BEGIN \
  HWY_BEFORE_NAMESPACE();     \
  namespace splatboost {      \
  namespace HWY_NAMESPACE {
#define SPLATBOOST_MATH_END \
  }                         \
  }                         \
  HWY_AFTER_NAMESPACE();
#endif

namespace splatboost {

/// Minimum and maximum that compile to one instruction (std::fmin must honour NaN on either side): a NaN in `a` yields
/// b.
SPLATBOOST_HOST_DEVICE constexpr float min_of(float a, float b) { return a < b ? a : b; }
SPLATBOOST_HOST_DEVICE constexpr float max_of(float a, float b) { return a > b ? a : b; }
SPLATBOOST_HOST_DEVICE float abs_of(float a) { return fabsf(a); }
SPLATBOOST_HOST_DEVICE float sqrt_of(float a) { return sqrtf(a); }
SPLATBOOST_HOST_DEVICE float floor_of(float a) { return floorf(a); }
SPLATBOOST_HOST_DEVICE float ceil_of(float a) { return ceilf(a); }
SPLATBOOST_HOST_DEVICE float reciprocal_of(float a) { return 1.0f / a; }
SPLATBOOST_HOST_DEVICE float log2_of(float a) { return log2f(a); }
/// a·b, rounded: not fused with a sum that it goes into.
SPLATBOOST_HOST_DEVICE float product_of(float a, float b) {
#if defined(__CUDA_ARCH__) || defined(SPLATBOOST_CUDA_ON_CPU)
  return __fmul_rn(a, b);
#else
  return a * b;
#endif
}
/// a where the condition holds, else b.
SPLATBOOST_HOST_DEVICE constexpr float select(bool condition, float a, float b) { return condition ? a : b; }

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Formulas shared by all devices are templates over a number type: `float` on a GPU and in scalar loops, a
/// vector of floats on a CPU (lanes-inl.h). This header has the macros that declare them and the functions of `float`.
#pragma once

#include <cmath>

// The emulator of the tests compiles .cu files with the host compiler and uses the same branch as nvcc.
#if defined(__CUDACC__) || defined(SPLATBOOST_CUDA_ON_CPU)
#include <cuda_runtime.h>
#define SPLATBOOST_HOST_DEVICE __host__ __device__ inline
// For CUDA the formulas are in one namespace ...
#define SPLATBOOST_MATH_BEGIN namespace splatboost {
#define SPLATBOOST_MATH_END }
#else
// Always inlined, so that a caller compiled for a wider instruction set gets the formula in that set.
#define SPLATBOOST_HOST_DEVICE inline __attribute__((always_inline))
// ... and for the CPU in one namespace per instruction set that they are compiled for.
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

/// Minimum and maximum that compile to one instruction, unlike std::fmin, which must handle a NaN in either argument.
/// If either argument is NaN the result is b.
SPLATBOOST_HOST_DEVICE constexpr float min_of(float a, float b) { return a < b ? a : b; }
SPLATBOOST_HOST_DEVICE constexpr float max_of(float a, float b) { return a > b ? a : b; }
SPLATBOOST_HOST_DEVICE float abs_of(float a) { return fabsf(a); }
SPLATBOOST_HOST_DEVICE float sqrt_of(float a) { return sqrtf(a); }
SPLATBOOST_HOST_DEVICE float floor_of(float a) { return floorf(a); }
SPLATBOOST_HOST_DEVICE float ceil_of(float a) { return ceilf(a); }
SPLATBOOST_HOST_DEVICE float reciprocal_of(float a) { return 1.0f / a; }
SPLATBOOST_HOST_DEVICE float log2_of(float a) { return log2f(a); }
/// a·b, rounded: on a GPU not fused with an addition of the result.
SPLATBOOST_HOST_DEVICE float product_of(float a, float b) {
#if defined(__CUDA_ARCH__) || defined(SPLATBOOST_CUDA_ON_CPU)
  return __fmul_rn(a, b);
#else
  return a * b;
#endif
}
/// a if the condition is true, else b.
SPLATBOOST_HOST_DEVICE constexpr float select(bool condition, float a, float b) { return condition ? a : b; }

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Replaces cuBLAS's header of this name: the functions that the .cu files call, as plain loops over column-major
/// matrices.
#pragma once

#include <cstddef>

#include "cuda_runtime.h"

enum cublasStatus_t { CUBLAS_STATUS_SUCCESS = 0, CUBLAS_STATUS_ALLOC_FAILED = 3, CUBLAS_STATUS_INVALID_VALUE = 7 };
enum cublasOperation_t { CUBLAS_OP_N = 0, CUBLAS_OP_T = 1 };

struct CublasOnCpu {
  cudaStream_t stream = nullptr;
};
using cublasHandle_t = CublasOnCpu*;

inline const char* cublasGetStatusName(cublasStatus_t status) {
  switch (status) {
    case CUBLAS_STATUS_SUCCESS:
      return "CUBLAS_STATUS_SUCCESS";
    case CUBLAS_STATUS_ALLOC_FAILED:
      return "CUBLAS_STATUS_ALLOC_FAILED";
    case CUBLAS_STATUS_INVALID_VALUE:
      return "CUBLAS_STATUS_INVALID_VALUE";
  }
  return "unknown";
}

/// Like cuBLAS, which allocates its workspace when it needs it, functions fail if the device has no free memory.
inline bool cublas_finds_memory() {
  std::size_t free = 0, total = 0;
  return cudaMemGetInfo(&free, &total) == cudaSuccess && free > 0;
}

inline cublasStatus_t cublasCreate(cublasHandle_t* handle) {
  if (!cublas_finds_memory()) return CUBLAS_STATUS_ALLOC_FAILED;
  *handle = new CublasOnCpu;
  return CUBLAS_STATUS_SUCCESS;
}

inline cublasStatus_t cublasDestroy(cublasHandle_t handle) {
  delete handle;
  return CUBLAS_STATUS_SUCCESS;
}

inline cublasStatus_t cublasSetStream(cublasHandle_t handle, cudaStream_t stream) {
  handle->stream = stream;
  return CUBLAS_STATUS_SUCCESS;
}

/// c [m,n] = alpha·op(a)·op(b) + beta·c, op(a) [m,k], op(b) [k,n]; ld*: distance between columns.
inline cublasStatus_t cublasSgemm(cublasHandle_t handle, cublasOperation_t of_a, cublasOperation_t of_b, int m, int n,
                                  int k, const float* alpha, const float* a, int lda, const float* b, int ldb,
                                  const float* beta, float* c, int ldc) {
  const bool a_turned = of_a == CUBLAS_OP_T, b_turned = of_b == CUBLAS_OP_T;
  if (m < 0 || n < 0 || k < 0 || lda < (a_turned ? k : m) || ldb < (b_turned ? n : k) || ldc < m) {
    return CUBLAS_STATUS_INVALID_VALUE;
  }
  if (!cublas_finds_memory()) return CUBLAS_STATUS_ALLOC_FAILED;
  cuda_on_cpu::give_work(handle->stream, [=, alpha = *alpha, beta = *beta] {
    const cuda_on_cpu::DeviceAccess access;
    const auto at = [](const float* matrix, int ld, int row, int column) {
      return matrix[static_cast<std::ptrdiff_t>(column) * ld + row];
    };
    for (int column = 0; column < n; ++column) {
      for (int row = 0; row < m; ++row) {
        float sum = 0;
        for (int i = 0; i < k; ++i) {
          sum += (a_turned ? at(a, lda, i, row) : at(a, lda, row, i)) *
                 (b_turned ? at(b, ldb, column, i) : at(b, ldb, i, column));
        }
        float& result = c[static_cast<std::ptrdiff_t>(column) * ldc + row];
        // As in cuBLAS, c may be uninitialized if beta is 0.
        result = alpha * sum + (beta == 0.0f ? 0.0f : beta * result);
      }
    }
  });
  return CUBLAS_STATUS_SUCCESS;
}

// SPDX-License-Identifier: Apache-2.0
/// @file Matrix products in CUDA device memory with cuBLAS. For .cu files.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {

/// Matrices are dense and row-major, have at least one row and column, and must not overlap. Arithmetic is in single
/// precision, without shorter internal formats. The workspace is reused: it grows only for larger matrices.
///
/// cuBLAS is loaded when the first object is constructed, not at program start, so that CPU runs do not pay the time
/// and memory of loading it.
class CudaMatrices {
 public:
  /// @param stream a stream that owns its CUDA stream, not one that borrows a caller's
  /// Throws NoDeviceError if the machine has no cuBLAS of the CUDA release used in this build.
  explicit CudaMatrices(CudaStream& stream);
  ~CudaMatrices();
  CudaMatrices(const CudaMatrices&) = delete;
  CudaMatrices& operator=(const CudaMatrices&) = delete;

  /// c [m,n] = a [m,k] · b [k,n]
  void multiply(std::span<const float> a, std::span<const float> b, std::span<float> c, std::size_t m, std::size_t n,
                std::size_t k);
  /// c [m,n] = a [m,k] · bᵀ, b [n,k]
  /// @param add whether to add to c instead of overwriting it
  void multiply_transposed(std::span<const float> a, std::span<const float> b, std::span<float> c, std::size_t m,
                           std::size_t n, std::size_t k, bool add = false);
  /// c [m,n] += aᵀ · b, a [k,m], b [k,n]
  void add_product_of_transposed(std::span<const float> a, std::span<const float> b, std::span<float> c, std::size_t m,
                                 std::size_t n, std::size_t k);
  /// sums[c] += Σ over the m rows of a [m,width], column first + c; summed in a fixed order
  void add_column_sums(std::span<const float> a, std::size_t m, std::size_t width, std::size_t first,
                       std::span<float> sums);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
/// @file Products of matrices in the memory of a CUDA device, by cuBLAS. For .cu files.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {

/// Matrices are dense and row-major, of at least one row and column, and must not overlap. Single precision
/// throughout: no shorter formats inside. Nothing is allocated once the tallest and the widest have been seen.
///
/// cuBLAS is loaded when the first of these is made, not when the program starts: what runs on the CPU shall not pay
/// the time and the memory that loading it takes.
class CudaMatrices {
 public:
  /// @param stream one of its own, not one that borrows a caller's
  /// Throws NoDeviceError where the machine has no cuBLAS of the CUDA release that this was built with.
  explicit CudaMatrices(CudaStream& stream);
  ~CudaMatrices();
  CudaMatrices(const CudaMatrices&) = delete;
  CudaMatrices& operator=(const CudaMatrices&) = delete;

  /// c [m,n] = a [m,k] · b [k,n]
  void multiply(std::span<const float> a, std::span<const float> b, std::span<float> c, std::size_t m, std::size_t n,
                std::size_t k);
  /// c [m,n] = a [m,k] · bᵀ, b [n,k]
  /// @param add to what c holds
  void multiply_transposed(std::span<const float> a, std::span<const float> b, std::span<float> c, std::size_t m,
                           std::size_t n, std::size_t k, bool add = false);
  /// c [m,n] += aᵀ · b, a [k,m], b [k,n]
  void add_product_of_transposed(std::span<const float> a, std::span<const float> b, std::span<float> c, std::size_t m,
                                 std::size_t n, std::size_t k);
  /// sums[c] += Σ over the m rows of a [m,width], column first + c; in a fixed order, by a kernel of its own
  void add_column_sums(std::span<const float> a, std::size_t m, std::size_t width, std::size_t first,
                       std::span<float> sums);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost::cuda

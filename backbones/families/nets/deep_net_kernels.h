// SPDX-License-Identifier: Apache-2.0
/// @file The arithmetic of deep_net.h for a piece of the rows, compiled once per instruction set; see net_kernels.h.
#pragma once

#include <cstddef>

namespace splatboost {

/// A plain DeepNetShape, and the number of rows of a piece, at least two.
struct DeepNetSizes {
  std::size_t rows, inputs, shared, hidden, layers, joined, outputs;
  std::size_t layer_stride;  ///< number of elements between consecutive layers in `values`
};

template <class Real>
struct DeepNetKernels {
  /// @param biases [layers,hidden] including the products of the shared inputs
  /// @param x [rows,inputs] @param values of all layers @param y [rows,outputs]
  void (*forward)(const DeepNetSizes&, const Real* parameters, const Real* biases, const Real* x, Real* values,
                  Real* y);
  /// @param scratch [2,rows,hidden]
  /// @param gradients of the parameters, are added to; those of the shared inputs' weights are not changed
  void (*backward)(const DeepNetSizes&, const Real* parameters, const Real* x, const Real* values,
                   const Real* y_gradient, Real* scratch, Real* gradients);
  /// x and, for k = 0 … frequencies − 1, sin(2ᵏ·x) and cos(2ᵏ·x), three coordinates each
  /// @param x [rows,3] @param encoded [rows,3·(1 + 2·frequencies)]
  void (*encode)(std::size_t rows, std::size_t frequencies, const Real* x, Real* encoded);
};

DeepNetKernels<float> portable_deep_net_kernels();
DeepNetKernels<float> avx2_deep_net_kernels();
DeepNetKernels<float> avx512_deep_net_kernels();
DeepNetKernels<double> double_deep_net_kernels();

}  // namespace splatboost

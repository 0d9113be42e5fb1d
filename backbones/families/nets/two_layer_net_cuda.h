// SPDX-License-Identifier: Apache-2.0
/// @file The nets of two_layer_net.h on a CUDA device: cuBLAS for the products, kernels for the rest. For .cu files.
#pragma once

#include <span>

#include "families/nets/matrices_cuda.h"
#include "families/nets/two_layer_net.h"

namespace splatboost::cuda {

/// Output activation.
enum class Activation { none, tanh, sigmoid };

/// Spans are in device memory; shapes as in two_layer_net.h. Spans may be longer than needed; the rest is not accessed.
class CudaNets {
 public:
  explicit CudaNets(CudaStream& stream) : stream_(stream), matrices_(stream) {}

  void forward(const NetShape& shape, std::span<const float> parameters, std::size_t rows, std::span<const float> x,
               Activation activation, std::span<float> hidden, std::span<float> y);
  /// @param y_gradient with respect to the input of the activation
  void backward(const NetShape& shape, std::span<const float> parameters, std::size_t rows, std::span<const float> x,
                std::span<const float> hidden, std::span<const float> y_gradient, std::span<float> hidden_gradient,
                std::span<float> parameter_gradients, std::span<float> x_gradient);
  CudaMatrices& matrices() { return matrices_; }

 private:
  CudaStream& stream_;
  CudaMatrices matrices_;
};

}  // namespace splatboost::cuda

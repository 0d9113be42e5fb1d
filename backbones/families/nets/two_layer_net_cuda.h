// SPDX-License-Identifier: Apache-2.0
/// @file The nets of two_layer_net.h on a CUDA device: products by cuBLAS, and kernels for what is between them. For
/// .cu files.
#pragma once

#include <span>

#include "families/nets/matrices_cuda.h"
#include "families/nets/two_layer_net.h"

namespace splatboost::cuda {

/// What follows the last layer.
enum class Activation { none, tanh, sigmoid };

/// Spans are of device memory, shapes as in two_layer_net.h; what is longer than needed is not touched beyond that.
class CudaNets {
 public:
  explicit CudaNets(CudaStream& stream) : stream_(stream), matrices_(stream) {}

  void forward(const NetShape& shape, std::span<const float> parameters, std::size_t rows, std::span<const float> x,
               Activation activation, std::span<float> hidden, std::span<float> y);
  /// @param y_gradient of what went into the activation
  void backward(const NetShape& shape, std::span<const float> parameters, std::size_t rows, std::span<const float> x,
                std::span<const float> hidden, std::span<const float> y_gradient, std::span<float> hidden_gradient,
                std::span<float> parameter_gradients, std::span<float> x_gradient);
  CudaMatrices& matrices() { return matrices_; }

 private:
  CudaStream& stream_;
  CudaMatrices matrices_;
};

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
/// @file y = W₂·relu(W₁·x + b₁) + b₂ for blocks of rows, and its gradient. Matrix products use Eigen, compiled for the
/// instruction set that the core uses.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "splatboost/random.h"

namespace splatboost {

/// Sizes of a net. Its parameters are one flat array: W₁ [hidden,inputs], b₁, W₂ [outputs,hidden], b₂, row-major.
struct NetShape {
  std::size_t inputs = 0;
  std::size_t hidden = 0;
  std::size_t outputs = 0;
  std::size_t parameters() const { return hidden * (inputs + 1) + outputs * (hidden + 1); }
};

/// Uniform in ±1/√(inputs of the layer), the usual default for linear layers.
/// @param first index of the first number of `random` to use
std::vector<float> initial_net_parameters(const NetShape& shape, const RandomStream& random, std::uint64_t first);

/// Rows are independent; a call runs on the calling thread. Real is float or double.
/// @param x [rows,inputs] @param hidden [rows,hidden] receives the activations that the gradient needs
/// @param y [rows,outputs]
template <class Real>
void net_forward(const NetShape& shape, std::span<const Real> parameters, std::size_t rows, const Real* x, Real* hidden,
                 Real* y);

/// @param y_gradient [rows,outputs]
/// @param hidden_gradient [rows,hidden] scratch, is overwritten
/// @param parameter_gradients flat, is added to
/// @param x_gradient [rows,inputs] is overwritten
template <class Real>
void net_backward(const NetShape& shape, std::span<const Real> parameters, std::size_t rows, const Real* x,
                  const Real* hidden, const Real* y_gradient, Real* hidden_gradient,
                  std::span<Real> parameter_gradients, Real* x_gradient);

/// Output activations, in place.
template <class Real>
void tanh_all(std::span<Real> values);
template <class Real>
void sigmoid_all(std::span<Real> values);

}  // namespace splatboost

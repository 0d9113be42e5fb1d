// SPDX-License-Identifier: Apache-2.0
/// @file The arithmetic of a two-layer net, compiled once per instruction set. Plain pointers and sizes only: an inline
/// function of another header would be compiled for these instructions too, and the linker might choose that instance
/// for machines that lack them.
#pragma once

#include <cstddef>

namespace splatboost {

struct NetSizes {
  std::size_t rows, inputs, hidden, outputs;
};

struct NetKernels {
  void (*forward)(NetSizes, const float* parameters, const float* x, float* hidden, float* y);
  void (*backward)(NetSizes, const float* parameters, const float* x, const float* hidden, const float* y_gradient,
                   float* hidden_gradient, float* parameter_gradients, float* x_gradient);
  void (*tanh)(float* values, std::size_t n);
  void (*sigmoid)(float* values, std::size_t n);
};

NetKernels portable_net_kernels();
NetKernels avx2_net_kernels();
NetKernels avx512_net_kernels();

void portable_net_forward(NetSizes, const double* parameters, const double* x, double* hidden, double* y);
void portable_net_backward(NetSizes, const double* parameters, const double* x, const double* hidden,
                           const double* y_gradient, double* hidden_gradient, double* parameter_gradients,
                           double* x_gradient);

}  // namespace splatboost

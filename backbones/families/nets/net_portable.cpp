// SPDX-License-Identifier: Apache-2.0
#define Eigen eigen_portable
#include "families/nets/net_kernels-inl.h"
// Uses the header above.
#include "families/nets/deep_net_kernels-inl.h"

namespace splatboost {

NetKernels portable_net_kernels() { return kKernels; }
DeepNetKernels<float> portable_deep_net_kernels() { return kDeepKernels<float>; }
DeepNetKernels<double> double_deep_net_kernels() { return kDeepKernels<double>; }

void portable_net_forward(NetSizes sizes, const double* parameters, const double* x, double* hidden, double* y) {
  forward(sizes, parameters, x, hidden, y);
}

void portable_net_backward(NetSizes sizes, const double* parameters, const double* x, const double* hidden,
                           const double* y_gradient, double* hidden_gradient, double* parameter_gradients,
                           double* x_gradient) {
  backward(sizes, parameters, x, hidden, y_gradient, hidden_gradient, parameter_gradients, x_gradient);
}

}  // namespace splatboost

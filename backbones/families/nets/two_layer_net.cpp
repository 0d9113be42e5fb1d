// SPDX-License-Identifier: Apache-2.0
#include "families/nets/two_layer_net.h"

#include <cmath>
#include <string>

#include "families/nets/net_kernels.h"
#include "families/nets/smooth_functions.h"
#include "splatboost/instruction_set.h"

namespace splatboost {
namespace {

/// For the instruction set that the rasterizer uses.
NetKernels kernels() {
#ifdef SPLATBOOST_NET_X86
  const std::string name = instruction_set_name();
  if (name.starts_with("AVX3") || name.starts_with("AVX10")) return avx512_net_kernels();
  if (name == "AVX2") return avx2_net_kernels();
#endif
  return portable_net_kernels();
}

}  // namespace

std::vector<float> initial_net_parameters(const NetShape& shape, const RandomStream& random, std::uint64_t first) {
  std::vector<float> parameters(shape.parameters());
  const std::size_t first_layer = shape.hidden * (shape.inputs + 1);
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    const double bound = 1.0 / std::sqrt(static_cast<double>(i < first_layer ? shape.inputs : shape.hidden));
    parameters[i] = static_cast<float>(bound * (2 * random.uniform(first + i) - 1));
  }
  return parameters;
}

template <>
void net_forward(const NetShape& shape, std::span<const float> parameters, std::size_t rows, const float* x,
                 float* hidden, float* y) {
  kernels().forward({rows, shape.inputs, shape.hidden, shape.outputs}, parameters.data(), x, hidden, y);
}

template <>
void net_forward(const NetShape& shape, std::span<const double> parameters, std::size_t rows, const double* x,
                 double* hidden, double* y) {
  portable_net_forward({rows, shape.inputs, shape.hidden, shape.outputs}, parameters.data(), x, hidden, y);
}

template <>
void net_backward(const NetShape& shape, std::span<const float> parameters, std::size_t rows, const float* x,
                  const float* hidden, const float* y_gradient, float* hidden_gradient,
                  std::span<float> parameter_gradients, float* x_gradient) {
  kernels().backward({rows, shape.inputs, shape.hidden, shape.outputs}, parameters.data(), x, hidden, y_gradient,
                     hidden_gradient, parameter_gradients.data(), x_gradient);
}

template <>
void net_backward(const NetShape& shape, std::span<const double> parameters, std::size_t rows, const double* x,
                  const double* hidden, const double* y_gradient, double* hidden_gradient,
                  std::span<double> parameter_gradients, double* x_gradient) {
  portable_net_backward({rows, shape.inputs, shape.hidden, shape.outputs}, parameters.data(), x, hidden, y_gradient,
                        hidden_gradient, parameter_gradients.data(), x_gradient);
}

template <>
void tanh_all(std::span<float> values) {
  kernels().tanh(values.data(), values.size());
}

template <>
void tanh_all(std::span<double> values) {
  for (double& value : values) value = smooth_tanh(value);
}

template <>
void sigmoid_all(std::span<float> values) {
  kernels().sigmoid(values.data(), values.size());
}

template <>
void sigmoid_all(std::span<double> values) {
  for (double& value : values) value = sigmoid(value);
}

}  // namespace splatboost

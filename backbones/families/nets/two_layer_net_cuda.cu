// SPDX-License-Identifier: Apache-2.0
#include "families/nets/two_layer_net_cuda.h"

#include "device/device_view.h"
#include "device/launch.h"
#include "families/nets/smooth_functions.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    hidden_layer_kernel(DeviceView<const float> biases, DeviceView<float> hidden) {
  const std::size_t i = element_index();
  if (i >= hidden.size()) return;
  const float value = hidden[i] + biases[i % biases.size()];
  hidden[i] = value > 0.0f ? value : 0.0f;
}

__global__ void __launch_bounds__(kBlockThreads)
    last_layer_kernel(DeviceView<const float> biases, Activation activation, DeviceView<float> y) {
  const std::size_t i = element_index();
  if (i >= y.size()) return;
  const float value = y[i] + biases[i % biases.size()];
  if (activation == Activation::tanh) {
    y[i] = smooth_tanh(value);
  } else {
    y[i] = activation == Activation::sigmoid ? sigmoid(value) : value;
  }
}

__global__ void __launch_bounds__(kBlockThreads)
    hidden_gradient_kernel(DeviceView<const float> hidden, DeviceView<float> gradient) {
  const std::size_t i = element_index();
  if (i < gradient.size() && !(hidden[i] > 0.0f)) gradient[i] = 0.0f;
}

/// Parts of the flat parameters.
template <class T>
struct Parts {
  Parts(const NetShape& shape, std::span<T> parameters)
      : w1(parameters.first(shape.hidden * shape.inputs)),
        b1(parameters.subspan(w1.size(), shape.hidden)),
        w2(parameters.subspan(w1.size() + b1.size(), shape.outputs * shape.hidden)),
        b2(parameters.subspan(w1.size() + b1.size() + w2.size(), shape.outputs)) {}
  std::span<T> w1, b1, w2, b2;
};

}  // namespace

void CudaNets::forward(const NetShape& shape, std::span<const float> parameters, std::size_t rows,
                       std::span<const float> x, Activation activation, std::span<float> hidden, std::span<float> y) {
  const Parts<const float> p(shape, parameters);
  hidden = hidden.first(rows * shape.hidden);
  y = y.first(rows * shape.outputs);
  matrices_.multiply_transposed(x, p.w1, hidden, rows, shape.hidden, shape.inputs);
  launch_each(stream_, "hidden_layer", hidden_layer_kernel, hidden.size(), p.b1, hidden);
  matrices_.multiply_transposed(hidden, p.w2, y, rows, shape.outputs, shape.hidden);
  launch_each(stream_, "last_layer", last_layer_kernel, y.size(), p.b2, activation, y);
}

void CudaNets::backward(const NetShape& shape, std::span<const float> parameters, std::size_t rows,
                        std::span<const float> x, std::span<const float> hidden, std::span<const float> y_gradient,
                        std::span<float> hidden_gradient, std::span<float> parameter_gradients,
                        std::span<float> x_gradient) {
  const Parts<const float> p(shape, parameters);
  const Parts<float> g(shape, parameter_gradients);
  hidden_gradient = hidden_gradient.first(rows * shape.hidden);
  matrices_.add_product_of_transposed(y_gradient, hidden, g.w2, shape.outputs, shape.hidden, rows);
  matrices_.add_column_sums(y_gradient, rows, shape.outputs, 0, g.b2);
  matrices_.multiply(y_gradient, p.w2, hidden_gradient, rows, shape.hidden, shape.outputs);
  launch_each(stream_, "hidden_gradient", hidden_gradient_kernel, hidden_gradient.size(), hidden, hidden_gradient);
  matrices_.add_product_of_transposed(hidden_gradient, x, g.w1, shape.hidden, shape.inputs, rows);
  matrices_.add_column_sums(hidden_gradient, rows, shape.hidden, 0, g.b1);
  matrices_.multiply(hidden_gradient, p.w1, x_gradient, rows, shape.inputs, shape.hidden);
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
#include "families/nets/deep_net_cuda.h"

#include "device/device_view.h"
#include "device/launch.h"

namespace splatboost::cuda {
namespace {

/// A layer's weights of the shared inputs; empty if the layer does not have these inputs.
struct SharedWeights {
  DeviceView<const float> weights;  ///< [hidden,shared]
  DeviceView<const float> shared;
};

__global__ void __launch_bounds__(kBlockThreads)
    whole_biases_kernel(DeviceView<const float> biases, SharedWeights inputs, DeviceView<float> whole) {
  const std::size_t i = element_index(), n = inputs.shared.size();
  if (i >= whole.size()) return;
  float sum = biases[i];
  for (std::size_t c = 0; !inputs.weights.empty() && c < n; ++c) sum += inputs.weights[i * n + c] * inputs.shared[c];
  whole[i] = sum;
}

__global__ void __launch_bounds__(kBlockThreads)
    deep_layer_kernel(DeviceView<const float> biases, bool relu, DeviceView<float> values) {
  const std::size_t i = element_index();
  if (i >= values.size()) return;
  const float value = values[i] + biases[i % biases.size()];
  values[i] = !relu || value > 0.0f ? value : 0.0f;
}

__global__ void __launch_bounds__(kBlockThreads)
    deep_relu_gradient_kernel(DeviceView<const float> values, DeviceView<float> gradient) {
  const std::size_t i = element_index();
  if (i < gradient.size() && !(values[i] > 0.0f)) gradient[i] = 0.0f;
}

__global__ void __launch_bounds__(kBlockThreads)
    add_gradients_kernel(DeviceView<const float> gradients, DeviceView<float> sums) {
  const std::size_t i = element_index();
  if (i < sums.size()) sums[i] += gradients[i];
}

__global__ void __launch_bounds__(kBlockThreads)
    shared_weight_gradients_kernel(DeviceView<const float> of_biases, DeviceView<const float> shared,
                                   DeviceView<float> sums) {
  const std::size_t i = element_index(), n = shared.size();
  if (i < sums.size()) sums[i] += of_biases[i / n] * shared[i % n];
}

__global__ void __launch_bounds__(kBlockThreads)
    shared_gradient_kernel(DeviceView<const float> of_biases, DeviceView<const float> weights, DeviceView<float> sums) {
  const std::size_t c = element_index(), n = sums.size();
  if (c >= n) return;
  float sum = sums[c];
  for (std::size_t i = 0; i < of_biases.size(); ++i) sum += of_biases[i] * weights[i * n + c];
  sums[c] = sum;
}

/// Parts of a layer in the flat parameters.
template <class T>
struct Parts {
  Parts(const DeepNetShape& shape, std::span<T> parameters, std::size_t layer) {
    const bool last = layer == shape.layers;
    const std::size_t outputs = last ? shape.outputs : shape.hidden;
    std::size_t at = shape.begin(layer);
    const auto take = [&](std::size_t width) {
      const std::span<T> part = parameters.subspan(at, outputs * width);
      at += part.size();
      return part;
    };
    const bool gets = !last && shape.gets_inputs(layer);
    inputs = take(gets ? shape.inputs : 0);
    shared = take(gets ? shape.shared : 0);
    below = take(layer > 0 ? shape.hidden : 0);
    biases = take(1);
  }
  std::span<T> inputs, shared, below, biases;
};

}  // namespace

void CudaDeepNet::forward(std::span<const float> parameters, std::span<const float> shared, std::size_t rows,
                          std::span<const float> x, std::span<float> y, bool keep) {
  rows_ = rows;
  const std::size_t layer_size = rows * shape_.hidden;
  values_.ensure((keep ? shape_.layers : 2) * layer_size);
  biases_.ensure(shape_.layers * shape_.hidden);
  std::span<const float> below;
  for (std::size_t l = 0; l < shape_.layers; ++l) {
    const Parts<const float> p(shape_, parameters, l);
    const std::span<float> biases = biases_.span().subspan(l * shape_.hidden, shape_.hidden);
    launch_each(stream_, "whole_biases", whole_biases_kernel, biases.size(), p.biases, SharedWeights{p.shared, shared},
                biases);
    const std::span<float> h = values_.span().subspan((keep ? l : l % 2) * layer_size, layer_size);
    if (!below.empty()) matrices_.multiply_transposed(below, p.below, h, rows, shape_.hidden, shape_.hidden);
    if (!p.inputs.empty()) {
      matrices_.multiply_transposed(x, p.inputs, h, rows, shape_.hidden, shape_.inputs, !below.empty());
    }
    launch_each(stream_, "deep_layer", deep_layer_kernel, h.size(), biases, true, h);
    below = h;
  }
  const Parts<const float> last(shape_, parameters, shape_.layers);
  y = y.first(rows * shape_.outputs);
  matrices_.multiply_transposed(below, last.below, y, rows, shape_.outputs, shape_.hidden);
  launch_each(stream_, "deep_layer", deep_layer_kernel, y.size(), last.biases, false, y);
}

void CudaDeepNet::backward(std::span<const float> parameters, std::span<const float> shared, std::span<const float> x,
                           std::span<const float> y_gradient, std::span<float> parameter_gradients,
                           std::span<float> shared_gradient) {
  const std::size_t layer_size = rows_ * shape_.hidden;
  gradients_.ensure(2 * layer_size);
  bias_gradients_.ensure(shape_.layers * shape_.hidden + shape_.outputs);
  bias_gradients_.fill_zero();
  stream_.fill_zero(shared_gradient.data(), shared_gradient.size_bytes());
  std::span<const float> above = y_gradient;
  std::size_t width = shape_.outputs;
  for (std::size_t l = shape_.layers + 1; l-- > 0;) {
    const Parts<const float> p(shape_, parameters, l);
    const Parts<float> g(shape_, parameter_gradients, l);
    const std::span<float> of_biases = bias_gradients_.span().subspan(l * shape_.hidden, width);
    matrices_.add_column_sums(above, rows_, width, 0, of_biases);
    launch_each(stream_, "add_gradients", add_gradients_kernel, width, of_biases, g.biases);
    if (!p.inputs.empty()) {
      matrices_.add_product_of_transposed(above, x, g.inputs, width, shape_.inputs, rows_);
      launch_each(stream_, "shared_weight_gradients", shared_weight_gradients_kernel, g.shared.size(), of_biases,
                  shared, g.shared);
      launch_each(stream_, "shared_gradient", shared_gradient_kernel, shared_gradient.size(), of_biases, p.shared,
                  shared_gradient);
    }
    if (l == 0) return;
    const std::span<const float> h = values_.span().subspan((l - 1) * layer_size, layer_size);
    matrices_.add_product_of_transposed(above, h, g.below, width, shape_.hidden, rows_);
    const std::span<float> to = gradients_.span().subspan((l % 2) * layer_size, layer_size);
    matrices_.multiply(above, p.below, to, rows_, shape_.hidden, width);
    launch_each(stream_, "deep_relu_gradient", deep_relu_gradient_kernel, to.size(), h, to);
    above = to;
    width = shape_.hidden;
  }
}

}  // namespace splatboost::cuda

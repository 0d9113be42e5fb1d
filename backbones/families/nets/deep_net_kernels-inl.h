// SPDX-License-Identifier: Apache-2.0
// Included once by each net_*.cpp, after net_kernels-inl.h, whose matrix types it uses.
#include "families/nets/deep_net_kernels.h"

namespace splatboost {
namespace {

/// Pointers to one layer's parts of the flat parameters; null: the layer does not have it.
template <class T>
struct DeepLayer {
  T *of_inputs = nullptr, *of_below = nullptr, *biases = nullptr;
};

template <class T>
DeepLayer<T> deep_layer(const DeepNetSizes& sizes, T* parameters, std::size_t layer) {
  T* at = parameters;
  for (std::size_t l = 0;; ++l) {
    DeepLayer<T> parts;
    if (l < sizes.layers && (l == 0 || l == sizes.joined)) {
      parts.of_inputs = at;
      at += sizes.hidden * (sizes.inputs + sizes.shared);
    }
    const std::size_t outputs = l < sizes.layers ? sizes.hidden : sizes.outputs;
    if (l > 0) {
      parts.of_below = at;
      at += outputs * sizes.hidden;
    }
    parts.biases = at;
    at += outputs;
    if (l == layer) return parts;
  }
}

template <class Real>
void bias_and_relu(std::size_t rows, std::size_t width, const Real* biases, Real* values) {
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < width; ++c) {
      const Real value = values[r * width + c] + biases[c];
      values[r * width + c] = value > Real(0) ? value : Real(0);
    }
  }
}

template <class Real>
void deep_forward(const DeepNetSizes& sizes, const Real* parameters, const Real* biases, const Real* x, Real* values,
                  Real* y) {
  const auto n = static_cast<Eigen::Index>(sizes.rows), in = static_cast<Eigen::Index>(sizes.inputs),
             width = static_cast<Eigen::Index>(sizes.hidden), out = static_cast<Eigen::Index>(sizes.outputs);
  const Real* below = nullptr;
  for (std::size_t l = 0; l < sizes.layers; ++l) {
    const auto layer = deep_layer(sizes, parameters, l);
    Real* const h = values + l * sizes.layer_stride;
    Rows<Real> result(h, n, width);
    if (layer.of_below != nullptr) {
      result.noalias() = ConstRows<Real>(below, n, width) * ConstRows<Real>(layer.of_below, width, width).transpose();
    } else {
      result.setZero();
    }
    if (layer.of_inputs != nullptr) {
      result.noalias() += ConstRows<Real>(x, n, in) * ConstRows<Real>(layer.of_inputs, width, in).transpose();
    }
    bias_and_relu(sizes.rows, sizes.hidden, biases + l * sizes.hidden, h);
    below = h;
  }
  const auto last = deep_layer(sizes, parameters, sizes.layers);
  Rows<Real> result(y, n, out);
  result.noalias() = ConstRows<Real>(below, n, width) * ConstRows<Real>(last.of_below, out, width).transpose();
  result.rowwise() += ConstRow<Real>(last.biases, out);
}

template <class Real>
void deep_backward(const DeepNetSizes& sizes, const Real* parameters, const Real* x, const Real* values,
                   const Real* y_gradient, Real* scratch, Real* gradients) {
  const auto n = static_cast<Eigen::Index>(sizes.rows), in = static_cast<Eigen::Index>(sizes.inputs),
             width = static_cast<Eigen::Index>(sizes.hidden), out = static_cast<Eigen::Index>(sizes.outputs);
  const std::size_t all = sizes.rows * sizes.hidden;
  const Real* of_above = y_gradient;  // gradient of the layer above, before its ReLU
  Eigen::Index above_width = out;
  for (std::size_t l = sizes.layers + 1; l-- > 0;) {
    const auto layer = deep_layer(sizes, parameters, l);
    const auto g = deep_layer(sizes, gradients, l);
    const ConstRows<Real> above(of_above, n, above_width);
    add_column_sums(of_above, n, above_width, g.biases);
    if (layer.of_inputs != nullptr) {
      Rows<Real>(g.of_inputs, above_width, in).noalias() += above.transpose() * ConstRows<Real>(x, n, in);
    }
    if (l == 0) return;
    const Real* const h = values + (l - 1) * sizes.layer_stride;
    Rows<Real>(g.of_below, above_width, width).noalias() += above.transpose() * ConstRows<Real>(h, n, width);
    Real* const to = scratch + (l % 2) * all;
    Rows<Real>(to, n, width).noalias() = above * ConstRows<Real>(layer.of_below, above_width, width);
    for (std::size_t i = 0; i < all; ++i) to[i] = h[i] > Real(0) ? to[i] : Real(0);
    of_above = to;
    above_width = width;
  }
}

template <class Real>
void encode_rows(std::size_t rows, std::size_t frequencies, const Real* x, Real* encoded) {
  // In blocks of fixed size: the remainder loop of a vectorised loop would round differently.
  constexpr std::size_t kBlock = 16, kMaxFrequencies = 32;
  const std::size_t count = 3 * frequencies, width = 3 + 2 * count;
  for (std::size_t r = 0; r < rows; ++r, x += 3, encoded += width) {
    for (std::size_t c = 0; c < 3; ++c) encoded[c] = x[c];
    alignas(64) Real angles[3 * kMaxFrequencies + kBlock] = {}, sines[3 * kMaxFrequencies + kBlock],
                                                  cosines[3 * kMaxFrequencies + kBlock];
    Real power = 1;
    for (std::size_t k = 0; k < frequencies; ++k, power *= 2) {
      for (std::size_t c = 0; c < 3; ++c) angles[3 * k + c] = x[c] * power;
    }
    for (std::size_t begin = 0; begin < count; begin += kBlock) {
      for (std::size_t i = begin; i < begin + kBlock; ++i) smooth_sine_cosine(angles[i], sines[i], cosines[i]);
    }
    for (std::size_t k = 0; k < frequencies; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        encoded[3 + 6 * k + c] = sines[3 * k + c];
        encoded[6 + 6 * k + c] = cosines[3 * k + c];
      }
    }
  }
}

template <class Real>
constexpr DeepNetKernels<Real> kDeepKernels{deep_forward<Real>, deep_backward<Real>, encode_rows<Real>};

}  // namespace
}  // namespace splatboost

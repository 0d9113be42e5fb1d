// SPDX-License-Identifier: Apache-2.0
/// @file MLP with hidden layers of equal width, for many rows: hₗ = relu(Wₗ·hₗ₋₁ + bₗ), y = W·h + b. The inputs enter
/// the first layer and, by a skip connection, one further layer. Some inputs are shared by all rows (the time of a
/// view): their products are computed once, not per row.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "splatboost/random.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Sizes of a net. Its parameters are one flat array, row-major. Each hidden layer has the weights of its inputs: of
/// the row's inputs [hidden,inputs] and the shared inputs [hidden,shared] if it gets them, of the layer below
/// [hidden,hidden] except in the first; then its biases [hidden]. The last layer has weights [outputs,hidden] and
/// biases [outputs].
struct DeepNetShape {
  std::size_t inputs = 0;
  std::size_t shared = 0;
  std::size_t hidden = 256;
  std::size_t layers = 8;  ///< hidden layers, with ReLU
  std::size_t joined = 5;  ///< index of the layer with the skip connection; 0: none
  std::size_t outputs = 0;

  bool gets_inputs(std::size_t layer) const { return layer == 0 || layer == joined; }
  std::size_t fan_in(std::size_t layer) const {
    return (gets_inputs(layer) ? inputs + shared : 0) + (layer > 0 ? hidden : 0);
  }
  /// Offset of a layer's parameters; `layers` is the last layer, `layers + 1` the end.
  std::size_t begin(std::size_t layer) const;
  std::size_t parameters() const { return begin(layers + 1); }
};

/// Uniform in ±1/√(inputs of the layer), the usual default for linear layers.
/// @param first index of the first number of `random` to use
std::vector<float> initial_deep_net_parameters(const DeepNetShape& shape, const RandomStream& random,
                                               std::uint64_t first);

/// A net on the CPU, with its workspace. Real is float or double.
template <class Real>
class DeepNet {
 public:
  /// Writes the inputs of the rows [begin, end) to x [end − begin,inputs]. Called from several threads.
  using WriteInputs = std::function<void(std::size_t begin, std::size_t end, Real* x)>;

  /// Memory per row that is kept between forward() and backward(), in bytes.
  static std::size_t bytes_per_row(const DeepNetShape& shape) {
    return (shape.inputs + shape.layers * shape.hidden) * sizeof(Real);
  }

  DeepNet(const DeepNetShape& shape, const Threads& threads) : shape_(shape), threads_(threads) {}

  /// @param shared [shared] @param y [rows,outputs]
  /// @param keep whether backward() follows
  void forward(std::span<const Real> parameters, std::span<const Real> shared, std::size_t rows,
               const WriteInputs& write_inputs, std::span<Real> y, bool keep);

  /// Backward pass of the last forward(); call it at most once per forward(). Rows with a zero gradient are skipped.
  /// @param y_gradient [rows,outputs]
  /// @param parameter_gradients are added to @param shared_gradient [shared] is overwritten
  void backward(std::span<const Real> parameters, std::span<const Real> shared, std::span<const Real> y_gradient,
                std::span<Real> parameter_gradients, std::span<Real> shared_gradient);

 private:
  std::size_t part_size() const;
  Real* part(std::size_t index);

  DeepNetShape shape_;
  Threads threads_;
  std::size_t rows_ = 0;
  std::vector<Real> biases_;   ///< [layers,hidden] including the products of the shared inputs
  std::vector<Real> kept_;     ///< inputs and layer values of each piece
  std::vector<Real> scratch_;  ///< per share
  std::vector<Real> sums_;     ///< [shares, parameters]
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file A net of many layers of one width on many rows: hₗ = relu(Wₗ·hₗ₋₁ + bₗ), y = W·h + b. The inputs go into the
/// first layer and, joined to what comes from below, into one further up. Some inputs are the same for all rows (the
/// time of a view): their products are made once, not once a row.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "splatboost/random.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Sizes of a net. Its parameters are one flat array, row-major. Each layer has, as far as it gets them, the weights of
/// the row's inputs [hidden,inputs], of the shared inputs [hidden,shared], of the layer below [hidden,hidden], then its
/// biases [hidden]; the last one has weights [outputs,hidden] and biases [outputs].
struct DeepNetShape {
  std::size_t inputs = 0;
  std::size_t shared = 0;
  std::size_t hidden = 256;
  std::size_t layers = 8;  ///< with relu
  std::size_t joined = 5;  ///< the layer that gets the inputs too; 0: none but the first
  std::size_t outputs = 0;

  bool gets_inputs(std::size_t layer) const { return layer == 0 || layer == joined; }
  std::size_t fan_in(std::size_t layer) const {
    return (gets_inputs(layer) ? inputs + shared : 0) + (layer > 0 ? hidden : 0);
  }
  /// Where the parameters of a layer begin; `layers`: those of the last one; `layers + 1`: their end.
  std::size_t begin(std::size_t layer) const;
  std::size_t parameters() const { return begin(layers + 1); }
};

/// Uniform in ±1/√(inputs of the layer), the field's default for linear layers.
/// @param first the number of `random` to begin with
std::vector<float> initial_deep_net_parameters(const DeepNetShape& shape, const RandomStream& random,
                                               std::uint64_t first);

/// A net on threads, with its workspace. Real is float or double.
template <class Real>
class DeepNet {
 public:
  /// Writes the inputs of the rows [begin, end) to x [end − begin,inputs]. Called from several threads.
  using WriteInputs = std::function<void(std::size_t begin, std::size_t end, Real* x)>;

  /// What is kept of a row between forward() and backward(), in bytes.
  static std::size_t bytes_per_row(const DeepNetShape& shape) {
    return (shape.inputs + shape.layers * shape.hidden) * sizeof(Real);
  }

  DeepNet(const DeepNetShape& shape, Threads& threads) : shape_(shape), threads_(threads) {}

  /// @param shared [shared] @param y [rows,outputs]
  /// @param keep whether backward() follows
  void forward(std::span<const Real> parameters, std::span<const Real> shared, std::size_t rows,
               const WriteInputs& write_inputs, std::span<Real> y, bool keep);

  /// Of the last forward(), once. Rows without a gradient cost nothing.
  /// @param y_gradient [rows,outputs]
  /// @param parameter_gradients are added to @param shared_gradient [shared] is overwritten
  void backward(std::span<const Real> parameters, std::span<const Real> shared, std::span<const Real> y_gradient,
                std::span<Real> parameter_gradients, std::span<Real> shared_gradient);

 private:
  std::size_t part_size() const;
  Real* part(std::size_t index);

  DeepNetShape shape_;
  Threads& threads_;
  std::size_t rows_ = 0;
  std::vector<Real> biases_;   ///< [layers,hidden] with what the shared inputs add
  std::vector<Real> kept_;     ///< of each piece: inputs, layers
  std::vector<Real> scratch_;  ///< of each share
  std::vector<Real> sums_;     ///< [shares, parameters]
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "families/nets/deep_net.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <type_traits>

#include "families/nets/deep_net_kernels.h"
#include "families/nets/frequency_encoding.h"
#include "families/nets/smooth_functions.h"
#include "splatboost/errors.h"
#include "splatboost/instruction_set.h"

namespace splatboost {
namespace {

/// Rows per piece; one layer's values of a piece fit into a core's cache.
constexpr std::size_t kPieceRows = 256;
/// Rows of a piece are padded to a multiple of this: Eigen computes products of a single row by another method, whose
/// rounding depends on the address.
constexpr std::size_t kRowMultiple = 8;
/// Maximum number of partial sums of gradients; each is over consecutive pieces, and they are then added in order.
constexpr std::size_t kMaxShares = 16;

template <class Real>
DeepNetKernels<Real> kernels() {
  if constexpr (std::is_same_v<Real, double>) {
    return double_deep_net_kernels();
  } else {
#ifdef SPLATBOOST_NET_X86
    // The instruction set that the rasterizer uses.
    const std::string name = instruction_set_name();
    if (name.starts_with("AVX3") || name.starts_with("AVX10")) return avx512_deep_net_kernels();
    if (name == "AVX2") return avx2_deep_net_kernels();
#endif
    return portable_deep_net_kernels();
  }
}

DeepNetSizes sizes_of(const DeepNetShape& shape, std::size_t rows) {
  return {rows,         shape.inputs, shape.shared,  shape.hidden,
          shape.layers, shape.joined, shape.outputs, kPieceRows * shape.hidden};
}

std::size_t filled_up(std::size_t rows) { return (rows + kRowMultiple - 1) / kRowMultiple * kRowMultiple; }

/// Offsets of the shared inputs' weights (if the layer has them) and of the biases of a layer.
struct SharedParts {
  SharedParts(const DeepNetShape& shape, std::size_t layer)
      : weights(shape.begin(layer) + shape.hidden * shape.inputs),
        biases(shape.begin(layer) + shape.hidden * shape.fan_in(layer)) {}
  std::size_t weights, biases;
};

}  // namespace

std::size_t DeepNetShape::begin(std::size_t layer) const {
  std::size_t at = 0;
  for (std::size_t l = 0; l < std::min(layer, layers); ++l) at += hidden * (fan_in(l) + 1);
  return layer > layers ? at + outputs * (hidden + 1) : at;
}

std::vector<float> initial_deep_net_parameters(const DeepNetShape& shape, const RandomStream& random,
                                               std::uint64_t first) {
  std::vector<float> parameters(shape.parameters());
  for (std::size_t layer = 0; layer <= shape.layers; ++layer) {
    const std::size_t inputs = layer < shape.layers ? shape.fan_in(layer) : shape.hidden;
    const double bound = 1.0 / std::sqrt(static_cast<double>(inputs));
    for (std::size_t i = shape.begin(layer); i < shape.begin(layer + 1); ++i) {
      parameters[i] = static_cast<float>(bound * (2 * random.uniform(first + i) - 1));
    }
  }
  return parameters;
}

template <class Real>
std::size_t DeepNet<Real>::part_size() const {
  return kPieceRows * (shape_.inputs + shape_.layers * shape_.hidden);
}

template <class Real>
Real* DeepNet<Real>::part(std::size_t index) {
  return kept_.data() + index * part_size();
}

template <class Real>
void DeepNet<Real>::forward(std::span<const Real> parameters, std::span<const Real> shared, std::size_t rows,
                            const WriteInputs& write_inputs, std::span<Real> y, bool keep) {
  SPLATBOOST_CHECK(
      parameters.size() == shape_.parameters() && shared.size() == shape_.shared && y.size() == rows * shape_.outputs,
      "the array sizes do not match the shape of the network");
  rows_ = rows;
  biases_.resize(shape_.layers * shape_.hidden);
  for (std::size_t l = 0; l < shape_.layers; ++l) {
    const SharedParts at(shape_, l);
    for (std::size_t i = 0; i < shape_.hidden; ++i) {
      Real sum = parameters[at.biases + i];
      for (std::size_t c = 0; shape_.gets_inputs(l) && c < shape_.shared; ++c) {
        sum += parameters[at.weights + i * shape_.shared + c] * shared[c];
      }
      biases_[l * shape_.hidden + i] = sum;
    }
  }
  const std::size_t pieces = (rows + kPieceRows - 1) / kPieceRows, shares = std::min(pieces, kMaxShares);
  const std::size_t parts = keep ? pieces : shares;
  if (kept_.size() < parts * part_size()) {
    kept_ = {};  // free the old buffer first; its contents are not needed
    kept_.resize(parts * part_size());
  }
  const std::size_t outputs_size = kPieceRows * shape_.outputs;
  if (scratch_.size() < shares * outputs_size) scratch_.resize(shares * outputs_size);
  const DeepNetKernels<Real> run = kernels<Real>();
  threads_.for_range(shares, 1, [&](std::size_t share, std::size_t) {
    for (std::size_t piece = pieces * share / shares; piece < pieces * (share + 1) / shares; ++piece) {
      Real* const x = part(keep ? piece : share);
      Real* const values = x + kPieceRows * shape_.inputs;
      Real* const outputs = scratch_.data() + share * outputs_size;
      const std::size_t begin = piece * kPieceRows, count = std::min(kPieceRows, rows - begin);
      write_inputs(begin, begin + count, x);
      std::fill(x + count * shape_.inputs, x + filled_up(count) * shape_.inputs, Real(0));
      run.forward(sizes_of(shape_, filled_up(count)), parameters.data(), biases_.data(), x, values, outputs);
      std::copy_n(outputs, count * shape_.outputs, y.data() + begin * shape_.outputs);
    }
  });
}

template <class Real>
void DeepNet<Real>::backward(std::span<const Real> parameters, std::span<const Real> shared,
                             std::span<const Real> y_gradient, std::span<Real> parameter_gradients,
                             std::span<Real> shared_gradient) {
  SPLATBOOST_CHECK(parameter_gradients.size() == shape_.parameters() && shared_gradient.size() == shape_.shared &&
                       y_gradient.size() == rows_ * shape_.outputs,
                   "the gradient sizes do not match the shape of the network");
  const std::size_t pieces = (rows_ + kPieceRows - 1) / kPieceRows, shares = std::min(pieces, kMaxShares);
  const std::size_t all = shape_.parameters();
  const std::size_t scratch_size = kPieceRows * (shape_.outputs + 2 * shape_.hidden);
  if (scratch_.size() < shares * scratch_size) scratch_.resize(shares * scratch_size);
  if (sums_.size() < shares * all) sums_.resize(shares * all);
  const DeepNetKernels<Real> run = kernels<Real>();
  threads_.for_range(shares, 1, [&](std::size_t share, std::size_t) {
    Real* const sums = sums_.data() + share * all;
    std::fill_n(sums, all, Real(0));
    Real* const of_y = scratch_.data() + share * scratch_size;
    for (std::size_t piece = pieces * share / shares; piece < pieces * (share + 1) / shares; ++piece) {
      Real* const x = part(piece);
      Real* const values = x + kPieceRows * shape_.inputs;
      const std::size_t begin = piece * kPieceRows, count = std::min(kPieceRows, rows_ - begin);
      // Move rows with a nonzero gradient to the front.
      std::size_t used = 0;
      for (std::size_t row = 0; row < count; ++row) {
        const Real* const given = y_gradient.data() + (begin + row) * shape_.outputs;
        if (std::all_of(given, given + shape_.outputs, [](Real g) { return g == Real(0); })) continue;
        std::copy_n(given, shape_.outputs, of_y + used * shape_.outputs);
        if (used != row) {
          std::copy_n(x + row * shape_.inputs, shape_.inputs, x + used * shape_.inputs);
          for (std::size_t l = 0; l < shape_.layers; ++l) {
            Real* const layer = values + l * kPieceRows * shape_.hidden;
            std::copy_n(layer + row * shape_.hidden, shape_.hidden, layer + used * shape_.hidden);
          }
        }
        ++used;
      }
      if (used == 0) continue;
      std::fill(of_y + used * shape_.outputs, of_y + filled_up(used) * shape_.outputs, Real(0));
      run.backward(sizes_of(shape_, filled_up(used)), parameters.data(), x, values, of_y,
                   of_y + kPieceRows * shape_.outputs, sums);
    }
  });
  std::vector<Real>& total = sums_;  // starts as the sum of the first share
  constexpr std::size_t kGrain = 1 << 14;
  threads_.for_range(all, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t share = 1; share < shares; ++share) {
      for (std::size_t i = begin; i < end; ++i) total[i] += sums_[share * all + i];
    }
    for (std::size_t i = begin; shares > 0 && i < end; ++i) parameter_gradients[i] += total[i];
  });
  std::fill(shared_gradient.begin(), shared_gradient.end(), Real(0));
  for (std::size_t l = 0; shares > 0 && l < shape_.layers; ++l) {
    if (!shape_.gets_inputs(l)) continue;
    const SharedParts at(shape_, l);
    for (std::size_t i = 0; i < shape_.hidden; ++i) {
      const Real of_sum = total[at.biases + i];
      for (std::size_t c = 0; c < shape_.shared; ++c) {
        const std::size_t weight = at.weights + i * shape_.shared + c;
        parameter_gradients[weight] += of_sum * shared[c];
        shared_gradient[c] += of_sum * parameters[weight];
      }
    }
  }
}

template class DeepNet<float>;
template class DeepNet<double>;

template <class Real>
void encode_positions(std::size_t rows, std::size_t frequencies, const Real* x, Real* encoded) {
  kernels<Real>().encode(rows, frequencies, x, encoded);
}
template void encode_positions(std::size_t, std::size_t, const float*, float*);
template void encode_positions(std::size_t, std::size_t, const double*, double*);

template <class Real>
void encode_number(Real x, std::span<Real> encoded) {
  encoded[0] = x;
  Real power = 1;
  for (std::size_t k = 0; 2 + 2 * k < encoded.size(); ++k, power *= 2) {
    smooth_sine_cosine(x * power, encoded[1 + 2 * k], encoded[2 + 2 * k]);
  }
}
template void encode_number(float, std::span<float>);
template void encode_number(double, std::span<double>);

}  // namespace splatboost

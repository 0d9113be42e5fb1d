// SPDX-License-Identifier: Apache-2.0
#include "anchors/two_layer_net.h"

#include <cmath>

#include <Eigen/Core>

namespace splatboost {
namespace {

template <class Real>
using Matrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
template <class Real>
using Rows = Eigen::Map<Matrix<Real>>;
template <class Real>
using ConstRows = Eigen::Map<const Matrix<Real>>;
template <class Real>
using ConstRow = Eigen::Map<const Eigen::Matrix<Real, 1, Eigen::Dynamic>>;
template <class Real>
using Row = Eigen::Map<Eigen::Matrix<Real, 1, Eigen::Dynamic>>;

Eigen::Index index(std::size_t n) { return static_cast<Eigen::Index>(n); }

/// The parts of a flat array of parameters.
struct Offsets {
  explicit Offsets(const NetShape& shape)
      : b1(shape.hidden * shape.inputs), w2(b1 + shape.hidden), b2(w2 + shape.outputs * shape.hidden) {}
  std::size_t b1, w2, b2;
};

}  // namespace

std::vector<float> initial_net_parameters(const NetShape& shape, const RandomStream& random, std::uint64_t first) {
  std::vector<float> parameters(shape.parameters());
  const std::size_t first_layer = Offsets(shape).w2;
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    const double bound = 1.0 / std::sqrt(static_cast<double>(i < first_layer ? shape.inputs : shape.hidden));
    parameters[i] = static_cast<float>(bound * (2 * random.uniform(first + i) - 1));
  }
  return parameters;
}

template <class Real>
void net_forward(const NetShape& shape, std::span<const Real> parameters, std::size_t rows, const Real* x, Real* hidden,
                 Real* y) {
  const Offsets at(shape);
  const Real* p = parameters.data();
  const auto n = index(rows), in = index(shape.inputs), middle = index(shape.hidden), out = index(shape.outputs);
  Rows<Real> h(hidden, n, middle);
  h.noalias() = ConstRows<Real>(x, n, in) * ConstRows<Real>(p, middle, in).transpose();
  h.rowwise() += ConstRow<Real>(p + at.b1, middle);
  h = h.cwiseMax(Real(0));
  Rows<Real> result(y, n, out);
  result.noalias() = h * ConstRows<Real>(p + at.w2, out, middle).transpose();
  result.rowwise() += ConstRow<Real>(p + at.b2, out);
}

template <class Real>
void net_backward(const NetShape& shape, std::span<const Real> parameters, std::size_t rows, const Real* x,
                  const Real* hidden, const Real* y_gradient, Real* hidden_gradient,
                  std::span<Real> parameter_gradients, Real* x_gradient) {
  const Offsets at(shape);
  const Real* p = parameters.data();
  Real* g = parameter_gradients.data();
  const auto n = index(rows), in = index(shape.inputs), middle = index(shape.hidden), out = index(shape.outputs);
  const ConstRows<Real> h(hidden, n, middle), dy(y_gradient, n, out);
  Rows<Real>(g + at.w2, out, middle).noalias() += dy.transpose() * h;
  Row<Real>(g + at.b2, out) += dy.colwise().sum();
  Rows<Real> dh(hidden_gradient, n, middle);
  dh.noalias() = dy * ConstRows<Real>(p + at.w2, out, middle);
  dh = (h.array() > Real(0)).select(dh, Real(0));
  Rows<Real>(g, middle, in).noalias() += dh.transpose() * ConstRows<Real>(x, n, in);
  Row<Real>(g + at.b1, middle) += dh.colwise().sum();
  Rows<Real>(x_gradient, n, in).noalias() = dh * ConstRows<Real>(p, middle, in);
}

template void net_forward(const NetShape&, std::span<const float>, std::size_t, const float*, float*, float*);
template void net_forward(const NetShape&, std::span<const double>, std::size_t, const double*, double*, double*);
template void net_backward(const NetShape&, std::span<const float>, std::size_t, const float*, const float*,
                           const float*, float*, std::span<float>, float*);
template void net_backward(const NetShape&, std::span<const double>, std::size_t, const double*, const double*,
                           const double*, double*, std::span<double>, double*);

}  // namespace splatboost

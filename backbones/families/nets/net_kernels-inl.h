// SPDX-License-Identifier: Apache-2.0
// Included once by each net_*.cpp, which renames Eigen's namespace first, so that the linker does not merge template
// instances compiled for different instruction sets.

// Use GEMM for all products: Eigen's method for small products rounds differently depending on the address.
#define EIGEN_GEMM_TO_COEFFBASED_THRESHOLD 0
#include <cstring>

#include <Eigen/Core>

#include "families/nets/net_kernels.h"
#include "families/nets/smooth_functions.h"

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

/// Sizes as Eigen::Index, and offsets of the parts of the flat parameters.
struct Layout {
  explicit Layout(NetSizes s)
      : n(static_cast<Eigen::Index>(s.rows)),
        in(static_cast<Eigen::Index>(s.inputs)),
        middle(static_cast<Eigen::Index>(s.hidden)),
        out(static_cast<Eigen::Index>(s.outputs)),
        b1(middle * in),
        w2(b1 + middle),
        b2(w2 + out * middle) {}
  Eigen::Index n, in, middle, out, b1, w2, b2;
};

template <class Real>
void forward(NetSizes sizes, const Real* p, const Real* x, Real* hidden, Real* y) {
  const Layout at(sizes);
  Rows<Real> h(hidden, at.n, at.middle);
  h.noalias() = ConstRows<Real>(x, at.n, at.in) * ConstRows<Real>(p, at.middle, at.in).transpose();
  h.rowwise() += ConstRow<Real>(p + at.b1, at.middle);
  h = h.cwiseMax(Real(0));
  Rows<Real> result(y, at.n, at.out);
  result.noalias() = h * ConstRows<Real>(p + at.w2, at.out, at.middle).transpose();
  result.rowwise() += ConstRow<Real>(p + at.b2, at.out);
}

/// Row by row: the order of summation does not depend on the address, unlike that of Eigen's sum().
template <class Real>
void add_column_sums(const Real* rows, Eigen::Index n, Eigen::Index width, Real* sums) {
  for (Eigen::Index r = 0; r < n; ++r) {
    for (Eigen::Index c = 0; c < width; ++c) sums[c] += rows[r * width + c];
  }
}

template <class Real>
void backward(NetSizes sizes, const Real* p, const Real* x, const Real* hidden, const Real* y_gradient,
              Real* hidden_gradient, Real* g, Real* x_gradient) {
  const Layout at(sizes);
  const ConstRows<Real> h(hidden, at.n, at.middle), dy(y_gradient, at.n, at.out);
  Rows<Real>(g + at.w2, at.out, at.middle).noalias() += dy.transpose() * h;
  add_column_sums(y_gradient, at.n, at.out, g + at.b2);
  Rows<Real> dh(hidden_gradient, at.n, at.middle);
  dh.noalias() = dy * ConstRows<Real>(p + at.w2, at.out, at.middle);
  dh = (h.array() > Real(0)).select(dh, Real(0));
  Rows<Real>(g, at.middle, at.in).noalias() += dh.transpose() * ConstRows<Real>(x, at.n, at.in);
  add_column_sums(hidden_gradient, at.n, at.middle, g + at.b1);
  Rows<Real>(x_gradient, at.n, at.in).noalias() = dh * ConstRows<Real>(p, at.middle, at.in);
}

/// In whole vectors, the last one padded: the remainder loop of a vectorised loop would round differently.
template <class Function>
void for_all(float* values, std::size_t n, Function&& function) {
  constexpr std::size_t kWidth = 16;
  for (std::size_t begin = 0; begin < n; begin += kWidth) {
    const std::size_t count = n - begin < kWidth ? n - begin : kWidth;
    alignas(64) float block[kWidth] = {};
    std::memcpy(block, values + begin, count * sizeof(float));
    for (std::size_t i = 0; i < kWidth; ++i) block[i] = function(block[i]);
    std::memcpy(values + begin, block, count * sizeof(float));
  }
}

void tanh_all(float* values, std::size_t n) {
  for_all(values, n, [](float x) { return smooth_tanh(x); });
}

void sigmoid_all(float* values, std::size_t n) {
  for_all(values, n, [](float x) { return sigmoid(x); });
}

constexpr NetKernels kKernels{forward<float>, backward<float>, tanh_all, sigmoid_all};

}  // namespace
}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Forward-mode dual numbers: a value and N derivatives, usable in the same code as a double.
#pragma once

#include <array>
#include <cmath>

namespace splatboost::reference {

/// A number and its partial derivatives with respect to N chosen variables. Comparisons use the value only, so code
/// with branches takes the same branch as for a double, and that branch is differentiated.
template <int N>
struct Dual {
  double value = 0;
  std::array<double, N> slopes{};

  Dual() = default;
  Dual(double constant) : value(constant) {}  // implicit, so that constants and variables can be mixed

  /// The k-th variable.
  static Dual variable(double value, int k) {
    Dual result(value);
    result.slopes[static_cast<std::size_t>(k)] = 1;
    return result;
  }

  /// f(x) from the value and derivative of f at x, by the chain rule.
  static Dual chain(const Dual& x, double value, double derivative) {
    Dual result(value);
    for (std::size_t k = 0; k < N; ++k) result.slopes[k] = derivative * x.slopes[k];
    return result;
  }

  friend Dual operator+(const Dual& a, const Dual& b) {
    Dual result(a.value + b.value);
    for (std::size_t k = 0; k < N; ++k) result.slopes[k] = a.slopes[k] + b.slopes[k];
    return result;
  }
  friend Dual operator-(const Dual& a, const Dual& b) {
    Dual result(a.value - b.value);
    for (std::size_t k = 0; k < N; ++k) result.slopes[k] = a.slopes[k] - b.slopes[k];
    return result;
  }
  friend Dual operator*(const Dual& a, const Dual& b) {
    Dual result(a.value * b.value);
    for (std::size_t k = 0; k < N; ++k) result.slopes[k] = a.slopes[k] * b.value + a.value * b.slopes[k];
    return result;
  }
  friend Dual operator/(const Dual& a, const Dual& b) {
    Dual result(a.value / b.value);
    for (std::size_t k = 0; k < N; ++k) result.slopes[k] = (a.slopes[k] - result.value * b.slopes[k]) / b.value;
    return result;
  }
  friend Dual operator-(const Dual& a) { return chain(a, -a.value, -1); }

  Dual& operator+=(const Dual& b) { return *this = *this + b; }
  Dual& operator-=(const Dual& b) { return *this = *this - b; }
  Dual& operator*=(const Dual& b) { return *this = *this * b; }

  friend Dual sqrt(const Dual& a) {
    const double root = std::sqrt(a.value);
    return chain(a, root, 0.5 / root);
  }
  friend Dual exp(const Dual& a) {
    const double power = std::exp(a.value);
    return chain(a, power, power);
  }
  friend Dual log(const Dual& a) { return chain(a, std::log(a.value), 1 / a.value); }
  friend Dual abs(const Dual& a) {
    // The derivative of |x| at 0 is taken as 0.
    return chain(a, std::abs(a.value), a.value > 0 ? 1.0 : a.value < 0 ? -1.0 : 0.0);
  }
};

inline double value_of(double x) { return x; }

template <int N>
double value_of(const Dual<N>& x) {
  return x.value;
}

}  // namespace splatboost::reference

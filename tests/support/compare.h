// SPDX-License-Identifier: Apache-2.0
/// @file Compares single precision with the double-precision reference, with tight tolerances away from thresholds.
///
/// Where a decision of the model (alpha against 1/255, transmittance against 1e-4, a tile listed or not) depends on
/// rounding, both results are correct. The reference marks those pixels as uncertain. They are left out of comparisons,
/// and tests assert that there are few; tolerances stay tight everywhere else.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace splatboost::test {

struct Tolerance {
  double relative = 1e-4;  ///< relative to an element's expected value
  double scale = 1e-5;     ///< relative to the largest expected magnitude
  double absolute = 0;     ///< in the unit of the values
  double l2 = 2e-5;        ///< ‖actual − expected‖ / ‖expected‖
};

/// For images with values of order one. Errors of single precision are about a third of this.
inline constexpr Tolerance kImageTolerance{.relative = 1e-5, .scale = 1e-6, .absolute = 1e-6, .l2 = 2e-6};
/// For gradients: they are sums over pixels of terms of both signs, so the scale of the whole tensor matters.
/// Errors of single precision are about a third of this.
inline constexpr Tolerance kGradientTolerance{.relative = 2e-4, .scale = 2e-5, .absolute = 0, .l2 = 2e-5};

/// Compares elements and the L2 norm. Element k belongs to pixel k % excluded.size(); excluded pixels are skipped.
inline ::testing::AssertionResult is_close(std::span<const float> actual, const std::vector<double>& expected,
                                           const Tolerance& tolerance, std::span<const std::uint8_t> excluded = {}) {
  if (actual.size() != expected.size()) {
    return ::testing::AssertionFailure() << "sizes differ: " << actual.size() << " and " << expected.size();
  }
  const auto skipped = [&](std::size_t k) { return !excluded.empty() && excluded[k % excluded.size()] != 0; };
  double largest = 0;
  for (std::size_t k = 0; k < expected.size(); ++k) {
    if (!skipped(k)) largest = std::max(largest, std::abs(expected[k]));
  }
  double error2 = 0;
  double norm2 = 0;
  std::size_t wrong = 0;
  std::size_t worst = 0;
  double worst_excess = 0;
  for (std::size_t k = 0; k < expected.size(); ++k) {
    if (skipped(k)) continue;
    const double error = std::abs(static_cast<double>(actual[k]) - expected[k]);
    const double bound = tolerance.absolute + tolerance.scale * largest + tolerance.relative * std::abs(expected[k]);
    error2 += error * error;
    norm2 += expected[k] * expected[k];
    if (!(error <= bound)) {  // NaN is wrong too
      const double excess = std::isfinite(error) && bound > 0 ? error / bound : 1e300;
      if (wrong++ == 0 || excess > worst_excess) {
        worst = k;
        worst_excess = excess;
      }
    }
  }
  if (wrong > 0) {
    return ::testing::AssertionFailure() << wrong << " of " << expected.size() << " elements are off; the worst is ["
                                         << worst << "]: " << actual[worst] << ", expected " << expected[worst]
                                         << " (largest " << largest << ", " << worst_excess << " times its bound)";
  }
  const double allowed =
      tolerance.l2 * std::sqrt(norm2) + tolerance.absolute * std::sqrt(static_cast<double>(expected.size()));
  if (!(std::sqrt(error2) <= allowed)) {
    return ::testing::AssertionFailure() << "norm of the error " << std::sqrt(error2) << " of " << std::sqrt(norm2)
                                         << ", allowed " << allowed;
  }
  return ::testing::AssertionSuccess();
}

/// Asserts that there are few uncertain elements: at most `fraction` of `total`, rounded up.
inline ::testing::AssertionResult are_few(std::size_t number, std::size_t total, double fraction = 0.02) {
  const auto allowed = static_cast<std::size_t>(std::ceil(fraction * static_cast<double>(total)));
  if (number <= allowed) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << number << " of " << total << " lie in the threshold band; allowed "
                                       << allowed;
}

inline std::size_t count_nonzero(std::span<const std::uint8_t> mask) {
  return static_cast<std::size_t>(std::count_if(mask.begin(), mask.end(), [](std::uint8_t m) { return m != 0; }));
}

}  // namespace splatboost::test

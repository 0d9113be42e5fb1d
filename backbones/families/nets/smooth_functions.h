// SPDX-License-Identifier: Apache-2.0
/// @file exp, sigmoid, tanh, sine and cosine in a form that compilers can vectorise: no branches, no calls. They have
/// internal linkage, because they are compiled for several instruction sets. GPUs use the same functions.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <type_traits>

#include "families/nets/shared_math.h"

namespace splatboost {

/// exp(x) with a relative error below 3e-7; x is clamped to [-87, 88]. Doubles use std::exp.
template <class Real>
SPLATBOOST_SHARED_MATH Real smooth_exp(Real x) {
  if constexpr (!std::is_same_v<Real, float>) {
    return std::exp(x);
  } else {
    // exp(x) = 2ⁿ·exp(r) with |r| <= ln 2 / 2, where the Taylor series of degree 7 is accurate to 1e-8.
    constexpr float kLog2E = 1.44269504f, kLn2High = 0.693359375f, kLn2Low = -2.12194440e-4f;
    constexpr float kRound = 12582912.0f;  // 1.5·2²³: adding it leaves the nearest whole number in the low bits
    const float bounded = std::min(std::max(x, -87.0f), 88.0f);
    const float shifted = bounded * kLog2E + kRound;
    const float n = shifted - kRound;
    const float r = (bounded - n * kLn2High) - n * kLn2Low;
    float series = 1.0f / 5040;
    series = series * r + 1.0f / 720;
    series = series * r + 1.0f / 120;
    series = series * r + 1.0f / 24;
    series = series * r + 1.0f / 6;
    series = series * r + 0.5f;
    series = series * r + 1.0f;
    series = series * r + 1.0f;
    const std::int32_t exponent = std::bit_cast<std::int32_t>(shifted) - std::bit_cast<std::int32_t>(kRound);
    return series * std::bit_cast<float>((exponent + 127) << 23);
  }
}

template <class Real>
SPLATBOOST_SHARED_MATH Real sigmoid(Real x) {
  return Real(1) / (Real(1) + smooth_exp(-x));
}

template <class Real>
SPLATBOOST_SHARED_MATH Real smooth_tanh(Real x) {
  return Real(1) - Real(2) / (smooth_exp(Real(2) * x) + Real(1));
}

/// sin(x) and cos(x) with an error below 2e-7, for |x| up to 1e9. Doubles use the standard library.
template <class Real>
SPLATBOOST_SHARED_MATH void smooth_sine_cosine(Real x, Real& sine, Real& cosine) {
  if constexpr (!std::is_same_v<Real, float>) {
    sine = std::sin(x);
    cosine = std::cos(x);
  } else {
    // Reduced by quarter turns in double precision, because x is a coordinate times a power of two and can be large.
    constexpr double kQuartersPerRadian = 0.63661977236758134, kQuarter = 1.5707963267948966;
    constexpr double kRound = 6755399441055744.0;  // 1.5·2⁵²: adding it leaves the nearest whole number in the low bits
    const double quarters = static_cast<double>(x) * kQuartersPerRadian;
    const double shifted = quarters + kRound;
    const auto r = static_cast<float>((quarters - (shifted - kRound)) * kQuarter);
    const auto quadrant = static_cast<std::int32_t>(std::bit_cast<std::int64_t>(shifted));
    const float square = r * r;
    const float odd =
        r + r * square * (-1.0f / 6 + square * (1.0f / 120 + square * (-1.0f / 5040 + square * (1.0f / 362880))));
    const float even =
        1.0f + square * (-0.5f + square * (1.0f / 24 + square * (-1.0f / 720 + square * (1.0f / 40320))));
    const bool turned = (quadrant & 1) != 0;
    const float s = turned ? even : odd, c = turned ? odd : even;
    sine = (quadrant & 2) != 0 ? -s : s;
    cosine = ((quadrant + 1) & 2) != 0 ? -c : c;
  }
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Selection criteria of one primitive.
#pragma once

#include <cmath>
#include <cstdint>

#include "device/host_device.h"

namespace splatboost {

inline constexpr double kLargestKey = 1.7976931348623157e308;
/// Above the key of any candidate.
inline constexpr double kNoCandidate = HUGE_VAL;

SPLATBOOST_HOST_DEVICE bool is_important(std::uint8_t candidate, std::int64_t importance, double threshold) {
  return candidate != 0 && static_cast<double>(importance) > threshold;
}

/// Exponential key of a weighted sample (Efraimidis and Spirakis 2006); candidates of weight 0 come after all others,
/// in random order. @param uniform in (0, 1)
SPLATBOOST_HOST_DEVICE double sample_key(float weight, double uniform) {
  return weight > 0.0f ? -log(uniform) / static_cast<double>(weight) : kLargestKey * uniform;
}

/// Smallest first; below kNoCandidate also for a priority of −∞.
SPLATBOOST_HOST_DEVICE double priority_key(float priority) {
  const double key = -static_cast<double>(priority);
  return key < kLargestKey ? key : kLargestKey;
}

}  // namespace splatboost

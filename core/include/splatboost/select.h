// SPDX-License-Identifier: Apache-2.0
/// @file Selects the primitives to grow and to prune by their scores. Masks are bytes, non-zero = selected. Operations
/// without a Device parameter work in host memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "splatboost/device.h"
#include "splatboost/random.h"

namespace splatboost {

/// Keeps growth candidates whose importance exceeds a threshold (VCD): candidate_i &= importance_i > threshold.
/// @return number kept
std::size_t keep_important(std::span<const std::int64_t> importance, double threshold,
                           std::span<std::uint8_t> candidates);

/// Keeps `keep` of the candidates, a weighted sample without replacement (VCP in the first half of the run). It uses
/// exponential keys (Efraimidis and Spirakis 2006): key_i = −ln(u_i) / weight_i, smallest first, ties by index.
/// Candidates of weight 0 are drawn at random after all others. If there are at most `keep` candidates, all stay.
void keep_weighted_sample(std::span<const float> weights, std::size_t keep, const RandomStream& random,
                          std::span<std::uint8_t> candidates);

/// Keeps the `keep` candidates of the largest priority, ties to the lower index.
/// @param priorities not NaN where there is a candidate; checked on the CPU only
void keep_largest(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> candidates);

/// Priority of a growth candidate: its gradient relative to the threshold that accepts it. Clones and splits are
/// accepted by different gradients, whose values are not comparable.
inline float growth_priority(float gradient, float threshold) {
  return threshold > 0 ? gradient / threshold : gradient;
}

/// Enforces a cap: of all primitives that clone or split, keeps the `keep` of the largest priority, ties to the lower
/// index.
/// @param priorities [N] as for keep_largest() @param clone,split [N]
void hold_cap(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> clone,
              std::span<std::uint8_t> split);

/// If every primitive is selected, deselects the one of the largest priority (ties: lowest index), so that a pass never
/// removes all.
/// @param priorities not NaN; checked on the CPU only, if every primitive is selected
/// @return number selected afterwards
std::size_t spare_one(std::span<const float> priorities, std::span<std::uint8_t> removals);

/// Selects primitives in ascending order of weight, ties by index, as long as the weights selected by this call sum to
/// at most `share` of the sum of all weights. Leaves primitives of weight 0, and those already selected, as they are.
/// @param weights [N] finite, at least 0
void select_least(std::span<const double> weights, double share, std::span<std::uint8_t> removals);

// The same selections in the memory of a device. On a GPU those that return a number wait for it.
std::size_t keep_important(std::span<const std::int64_t> importance, double threshold,
                           std::span<std::uint8_t> candidates, Device device);
/// On a GPU the logarithm is the device's: keys may differ from those of the CPU in the last bit.
void keep_weighted_sample(std::span<const float> weights, std::size_t keep, const RandomStream& random,
                          std::span<std::uint8_t> candidates, Device device);
void keep_largest(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> candidates,
                  Device device);
std::size_t spare_one(std::span<const float> priorities, std::span<std::uint8_t> removals, Device device);

}  // namespace splatboost

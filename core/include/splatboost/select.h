// SPDX-License-Identifier: Apache-2.0
/// @file From scores to decisions: which primitives grow and which go. Masks are bytes, non-zero = selected. Operations
/// without a device work in memory of the host.
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

/// Keeps `keep` of the candidates, drawn without replacement and weighted (VCP before half of the run). The draw is
/// exponential keys (Efraimidis and Spirakis 2006): key_i = −ln(u_i) / weight_i, smallest first; ties by index.
/// Candidates of weight 0 are drawn only after all others, at random. If there are at most `keep` candidates, all stay.
void keep_weighted_sample(std::span<const float> weights, std::size_t keep, const RandomStream& random,
                          std::span<std::uint8_t> candidates);

/// Keeps the `keep` candidates of the largest priority, ties to the lower index.
void keep_largest(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> candidates);

/// How strongly a candidate asks to grow: its gradient, relative to the threshold that accepts it. Clones and splits
/// are accepted by different gradients, whose values say nothing about each other.
inline float growth_priority(float gradient, float threshold) {
  return threshold > 0 ? gradient / threshold : gradient;
}

/// Holds a cap: of all that clone or split keeps the `keep` of the largest priority, ties to the lower index.
/// @param priorities [N] @param clone,split [N]
void hold_cap(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> clone,
              std::span<std::uint8_t> split);

/// A pass never removes all: if every primitive is selected, the one of the largest priority (ties: lowest index)
/// is deselected. @return number selected afterwards
std::size_t spare_one(std::span<const float> priorities, std::span<std::uint8_t> removals);

/// Selects those of the smallest weights, in ascending order and ties by index, as long as all that this call selects
/// have together at most `share` of the sum of all weights. What has weight 0 is left as it is.
/// @param weights at least 0 and finite
void select_least(std::span<const double> weights, double share, std::span<std::uint8_t> removals);

// The same decisions in the memory of a device. On a GPU those that return a number wait for it.
std::size_t keep_important(std::span<const std::int64_t> importance, double threshold,
                           std::span<std::uint8_t> candidates, Device device);
/// The logarithm is the device's: keys may differ from the CPU's in their last bit.
void keep_weighted_sample(std::span<const float> weights, std::size_t keep, const RandomStream& random,
                          std::span<std::uint8_t> candidates, Device device);
void keep_largest(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> candidates,
                  Device device);
std::size_t spare_one(std::span<const float> priorities, std::span<std::uint8_t> removals, Device device);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Stateless random numbers: a pure function of seed, iteration, purpose and index.
#pragma once

#include <cmath>
#include <cstdint>

namespace splatboost {

/// Mixes 64 bits so that every input bit affects every output bit (the finaliser of SplitMix64, Steele et al. 2014).
constexpr std::uint64_t mix_bits(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ull;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}

/// Purpose of a stream of random numbers. Each purpose has its own stream, so that switching one feature on or off
/// does not change the numbers of another.
enum class RandomPurpose : std::uint64_t {
  view_order,
  scored_views,
  split,
  prune,
  init_points,
  background,
  dropout,
  synth,
  grow,
  net_parameters,
  time_noise,
  neighbor_view,
  patches,
  virtual_camera
};

/// The stream of (seed, iteration, purpose). Its i-th number does not depend on the order of calls or on threads.
class RandomStream {
 public:
  constexpr RandomStream(std::uint64_t seed, std::uint64_t iteration, RandomPurpose purpose)
      : key_(mix_bits(mix_bits(mix_bits(seed) ^ iteration) ^ static_cast<std::uint64_t>(purpose))) {}

  constexpr std::uint64_t bits(std::uint64_t i) const { return mix_bits(key_ ^ mix_bits(i)); }

  /// Uniform in (0, 1).
  constexpr double uniform(std::uint64_t i) const { return (static_cast<double>(bits(i) >> 12) + 0.5) * 0x1.0p-52; }

  /// Uniform in 0 .. n-1; n > 0 and far below 2^64.
  std::uint64_t below(std::uint64_t i, std::uint64_t n) const { return bits(i) % n; }

  /// Standard normal (Box-Muller on numbers 2i and 2i+1).
  double normal(std::uint64_t i) const {
    constexpr double kTwoPi = 6.283185307179586;
    return std::sqrt(-2.0 * std::log(uniform(2 * i))) * std::cos(kTwoPi * uniform(2 * i + 1));
  }

 private:
  std::uint64_t key_;
};

}  // namespace splatboost

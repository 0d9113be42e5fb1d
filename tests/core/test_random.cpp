// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <set>
#include <vector>

#include "splatboost/random.h"

namespace splatboost::test {
namespace {

// The published first outputs of SplitMix64 with seed 0: the finaliser applied to multiples of the golden gamma.
TEST(Random, MixesAsSplitMix64) {
  EXPECT_EQ(mix_bits(0), 0xe220a8397b1dcdafull);
  EXPECT_EQ(mix_bits(0x9e3779b97f4a7c15ull), 0x6e789e6aa1b965f4ull);
  EXPECT_EQ(mix_bits(2 * 0x9e3779b97f4a7c15ull), 0x06c45d188009454full);
}

TEST(Random, StreamsAreFunctionsOfTheirKey) {
  const RandomStream a(1, 2, RandomPurpose::split);
  const RandomStream b(1, 2, RandomPurpose::split);
  std::vector<std::uint64_t> forwards;
  for (std::uint64_t i = 0; i < 100; ++i) forwards.push_back(a.bits(i));
  for (std::uint64_t i = 100; i-- > 0;) EXPECT_EQ(b.bits(i), forwards[i]) << i;  // in any order
}

TEST(Random, StreamsShareNoNumbers) {
  std::set<std::uint64_t> seen;
  std::size_t drawn = 0;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    for (std::uint64_t iteration = 0; iteration < 4; ++iteration) {
      for (const RandomPurpose purpose : {RandomPurpose::view_order, RandomPurpose::scored_views, RandomPurpose::split,
                                          RandomPurpose::prune, RandomPurpose::synth, RandomPurpose::grow}) {
        const RandomStream stream(seed, iteration, purpose);
        for (std::uint64_t i = 0; i < 50; ++i, ++drawn) seen.insert(stream.bits(i));
      }
    }
  }
  EXPECT_EQ(seen.size(), drawn);
}

TEST(Random, UniformFillsTheOpenInterval) {
  const RandomStream stream(7, 1, RandomPurpose::synth);
  const int n = 200000;
  std::vector<int> bins(20, 0);
  double sum = 0;
  double lag = 0;
  for (int i = 0; i < n; ++i) {
    const double u = stream.uniform(static_cast<std::uint64_t>(i));
    ASSERT_GT(u, 0);
    ASSERT_LT(u, 1);
    ++bins[static_cast<std::size_t>(20 * u)];
    sum += u;
    lag += (u - 0.5) * (stream.uniform(static_cast<std::uint64_t>(i) + 1) - 0.5);
  }
  EXPECT_NEAR(sum / n, 0.5, 5 * 0.2887 / std::sqrt(n));
  EXPECT_NEAR(lag / n, 0, 5 * (1.0 / 12) / std::sqrt(n));
  double chi2 = 0;
  for (const int bin : bins) chi2 += std::pow(bin - n / 20.0, 2) / (n / 20.0);
  EXPECT_LT(chi2, 50);  // 19 degrees of freedom: 50 is beyond 1e-4
}

// The same along seeds and iterations, which would reveal a weak key schedule.
TEST(Random, UniformAlongTheKey) {
  const int n = 50000;
  double sum = 0;
  double lag = 0;
  for (int k = 0; k < n; ++k) {
    const auto at = [](int iteration) {
      return RandomStream(3, static_cast<std::uint64_t>(iteration), RandomPurpose::prune).uniform(0);
    };
    sum += at(k);
    lag += (at(k) - 0.5) * (at(k + 1) - 0.5);
  }
  EXPECT_NEAR(sum / n, 0.5, 5 * 0.2887 / std::sqrt(n));
  EXPECT_NEAR(lag / n, 0, 5 * (1.0 / 12) / std::sqrt(n));
}

TEST(Random, NormalHasItsMoments) {
  const RandomStream stream(8, 1, RandomPurpose::split);
  const int n = 200000;
  double m1 = 0, m2 = 0, m3 = 0, m4 = 0;
  for (int i = 0; i < n; ++i) {
    const double x = stream.normal(static_cast<std::uint64_t>(i));
    ASSERT_TRUE(std::isfinite(x));
    m1 += x / n;
    m2 += x * x / n;
    m3 += x * x * x / n;
    m4 += x * x * x * x / n;
  }
  const double deviation = 1 / std::sqrt(n);
  EXPECT_NEAR(m1, 0, 5 * deviation);
  EXPECT_NEAR(m2, 1, 5 * std::sqrt(2.0) * deviation);
  EXPECT_NEAR(m3, 0, 5 * std::sqrt(15.0) * deviation);
  EXPECT_NEAR(m4, 3, 5 * std::sqrt(96.0) * deviation);
}

TEST(Random, BelowIsBelow) {
  const RandomStream stream(9, 1, RandomPurpose::view_order);
  std::vector<int> seen(7, 0);
  for (std::uint64_t i = 0; i < 7000; ++i) {
    const std::uint64_t x = stream.below(i, 7);
    ASSERT_LT(x, 7u);
    ++seen[x];
  }
  for (const int number : seen) EXPECT_NEAR(number, 1000, 150);
  EXPECT_EQ(stream.below(0, 1), 0u);
}

}  // namespace
}  // namespace splatboost::test

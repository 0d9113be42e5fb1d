// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "reference/training.h"
#include "splatboost/errors.h"
#include "splatboost/select.h"
#include "support/compare.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

using Mask = std::vector<std::uint8_t>;

RandomStream stream(std::uint64_t seed) { return RandomStream(seed, 1, RandomPurpose::prune); }

/// Any non-zero byte of a mask means selected; tests compare 0 and 1.
Mask normalized(Mask mask) {
  for (std::uint8_t& byte : mask) byte = byte != 0 ? 1 : 0;
  return mask;
}

TEST(KeepImportant, NeedsMoreThanTheThreshold) {
  const std::vector<std::int64_t> importance{0, 5, 6, 100, 6, -1};
  Mask candidates{1, 1, 1, 0, 1, 1};
  EXPECT_EQ(keep_important(importance, 5, candidates), 2u);
  EXPECT_EQ(normalized(candidates), (Mask{0, 0, 1, 0, 1, 0}));
  Mask fractional{1, 1, 1, 1, 1, 1};
  EXPECT_EQ(keep_important(importance, 4.5, fractional), 4u);
  EXPECT_EQ(normalized(fractional), (Mask{0, 1, 1, 1, 1, 0}));
}

TEST(KeepImportant, OfNothingIsNothing) {
  EXPECT_EQ(keep_important({}, 5, {}), 0u);
  Mask none{0, 0};
  EXPECT_EQ(keep_important(std::vector<std::int64_t>{9, 9}, 5, none), 0u);
}

TEST(KeepWeightedSample, KeepsTheNumberAskedAmongCandidatesOnly) {
  Numbers random(3);
  std::vector<float> weights;
  Mask candidates;
  for (int i = 0; i < 500; ++i) {
    weights.push_back(random.real(0, 1));
    candidates.push_back(random.uniform(0, 1) < 0.6 ? static_cast<std::uint8_t>(1 + i % 200) : std::uint8_t{0});
  }
  const std::size_t number = count_nonzero(candidates);
  for (const std::size_t keep : {std::size_t{0}, std::size_t{1}, number / 2, number - 1, number, number + 7}) {
    Mask kept = candidates;
    keep_weighted_sample(weights, keep, stream(keep), kept);
    EXPECT_EQ(count_nonzero(kept), std::min(keep, number));
    for (std::size_t i = 0; i < kept.size(); ++i) EXPECT_TRUE(kept[i] == 0 || candidates[i] != 0);
  }
}

TEST(KeepWeightedSample, DependsOnTheStreamAlone) {
  std::vector<float> weights(64, 1);
  Mask a(64, 1);
  Mask b(64, 1);
  Mask c(64, 1);
  keep_weighted_sample(weights, 20, stream(5), a);
  keep_weighted_sample(weights, 20, stream(5), b);
  keep_weighted_sample(weights, 20, stream(6), c);
  EXPECT_EQ(a, b);
  EXPECT_NE(a, c);
}

// The contract defines the keys, so the selected set is determined.
TEST(KeepWeightedSample, SortsExponentialKeys) {
  Numbers random(9);
  std::vector<float> weights;
  for (int i = 0; i < 200; ++i) weights.push_back(static_cast<float>(random.magnitude(1e-3, 10)));
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    std::vector<std::pair<double, std::size_t>> keys;
    for (std::size_t i = 0; i < weights.size(); ++i) {
      keys.emplace_back(-std::log(stream(seed).uniform(i)) / static_cast<double>(weights[i]), i);
    }
    std::sort(keys.begin(), keys.end());
    Mask expected(weights.size(), 0);
    for (std::size_t k = 0; k < 70; ++k) expected[keys[k].second] = 1;
    Mask kept(weights.size(), 1);
    keep_weighted_sample(weights, 70, stream(seed), kept);
    EXPECT_EQ(normalized(kept), expected);
  }
}

// Inclusion frequencies over many streams against the exact probabilities of drawing without replacement.
TEST(KeepWeightedSample, IncludesWithTheRightChances) {
  const std::vector<double> weights{0.5, 1, 2, 4, 8, 1};
  const std::vector<float> given(weights.begin(), weights.end());
  const int trials = 40000;
  for (const std::size_t keep : {1u, 3u, 5u}) {
    const auto chances = reference::inclusion_probabilities(weights, keep);
    std::vector<int> included(weights.size(), 0);
    for (int trial = 0; trial < trials; ++trial) {
      Mask kept(weights.size(), 1);
      keep_weighted_sample(given, keep, RandomStream(1234, static_cast<std::uint64_t>(trial), RandomPurpose::prune),
                           kept);
      for (std::size_t i = 0; i < kept.size(); ++i) included[i] += kept[i] != 0 ? 1 : 0;
    }
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const double deviation = std::sqrt(chances[i] * (1 - chances[i]) / trials);
      EXPECT_NEAR(included[i] / static_cast<double>(trials), chances[i], 4.5 * deviation)
          << "keep " << keep << ", item " << i;
    }
  }
}

TEST(KeepWeightedSample, WeightZeroComesLast) {
  const std::vector<float> weights{0, 1e-30f, 0, 5, 0, 1};
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Mask three(6, 1);
    keep_weighted_sample(weights, 3, stream(seed), three);
    ASSERT_EQ(normalized(three), (Mask{0, 1, 0, 1, 0, 1}));
    Mask five(6, 1);
    keep_weighted_sample(weights, 5, stream(seed), five);
    ASSERT_EQ(count_nonzero(five), 5u);
    ASSERT_TRUE(five[1] != 0 && five[3] != 0 && five[5] != 0);
  }
  Mask all(6, 1);
  keep_weighted_sample(std::vector<float>(6, 0.0f), 2, stream(1), all);
  EXPECT_EQ(count_nonzero(all), 2u);
}

TEST(KeepLargest, HoldsACap) {
  const std::vector<float> priorities{3, 9, 3, -1, 3, 8, 100};
  const auto kept = [&](std::size_t keep) {
    Mask candidates{1, 1, 1, 1, 1, 1, 0};
    keep_largest(priorities, keep, candidates);
    return normalized(candidates);
  };
  EXPECT_EQ(kept(0), (Mask{0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(kept(1), (Mask{0, 1, 0, 0, 0, 0, 0}));
  EXPECT_EQ(kept(3), (Mask{1, 1, 0, 0, 0, 1, 0}));  // the first of the three 3s
  EXPECT_EQ(kept(4), (Mask{1, 1, 1, 0, 0, 1, 0}));
  EXPECT_EQ(kept(6), (Mask{1, 1, 1, 1, 1, 1, 0}));
  EXPECT_EQ(kept(99), (Mask{1, 1, 1, 1, 1, 1, 0}));
}

TEST(KeepLargest, RefusesCandidatesThatCannotBeRanked) {
  std::vector<float> priorities(100, 1.0f);
  priorities[70] = std::numeric_limits<float>::quiet_NaN();
  Mask candidates(100, 1), split(100, 0);
  EXPECT_THROW(keep_largest(priorities, 3, candidates), ArgumentError);
  EXPECT_THROW(hold_cap(priorities, 3, candidates, split), ArgumentError);
  EXPECT_EQ(candidates, Mask(100, 1));
  candidates[70] = 0;
  EXPECT_NO_THROW(keep_largest(priorities, 3, candidates));
}

TEST(SpareOne, RefusesWhatCannotBeRanked) {
  std::vector<float> priorities{1, std::numeric_limits<float>::quiet_NaN(), 2};
  Mask removals(3, 1);
  EXPECT_THROW(spare_one(priorities, removals), ArgumentError);
  EXPECT_EQ(removals, Mask(3, 1));
  removals[0] = 0;
  EXPECT_EQ(spare_one(priorities, removals), 2u);
}

TEST(KeepLargest, AgreesWithASort) {
  Numbers random(13);
  std::vector<float> priorities;
  Mask candidates;
  for (int i = 0; i < 1000; ++i) {
    priorities.push_back(static_cast<float>(random.bits() % 50));  // many ties
    candidates.push_back(random.uniform(0, 1) < 0.7 ? 1 : 0);
  }
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < 1000; ++i) {
    if (candidates[i] != 0) order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return priorities[a] > priorities[b]; });
  for (const std::size_t keep : {1u, 10u, 333u, 600u}) {
    Mask expected(1000, 0);
    for (std::size_t k = 0; k < std::min<std::size_t>(keep, order.size()); ++k) expected[order[k]] = 1;
    Mask kept = candidates;
    keep_largest(priorities, keep, kept);
    EXPECT_EQ(normalized(kept), expected);
  }
}

TEST(HoldCap, KeepsTheLargestOfBothMasksTogether) {
  const std::vector<float> priorities{1, 5, 2, 9, 2, 3};
  const Mask clones{1, 0, 1, 0, 0, 1}, splits{0, 1, 0, 0, 1, 1};  // primitive 3 is in neither mask, 5 in both
  const auto held = [&](std::size_t keep) {
    Mask clone = clones, split = splits;
    hold_cap(priorities, keep, clone, split);
    return std::pair(clone, split);
  };
  EXPECT_EQ(held(9), std::pair(clones, splits));
  EXPECT_EQ(held(5), std::pair(clones, splits));
  EXPECT_EQ(held(3), std::pair(Mask{0, 0, 1, 0, 0, 1}, Mask{0, 1, 0, 0, 0, 1})) << "ties go to the lower index";
  EXPECT_EQ(held(1), std::pair(Mask{0, 0, 0, 0, 0, 0}, Mask{0, 1, 0, 0, 0, 0}));
  EXPECT_EQ(held(0), std::pair(Mask(6, 0), Mask(6, 0)));
  Mask clone = clones, shorter{1, 1};
  EXPECT_THROW(hold_cap(priorities, 1, clone, shorter), ArgumentError);
}

TEST(Select, OnTheCpuADeviceIsTheHost) {
  Threads threads(2);
  const std::vector<std::int64_t> importance{1, 7, 3, 9};
  const std::vector<float> priorities{1, 7, 3, 9};
  const auto same = [](const auto& host, const auto& device) {
    Mask a{1, 1, 0, 1}, b = a;
    host(a);
    device(b);
    EXPECT_EQ(a, b);
    EXPECT_NE(a, (Mask{1, 1, 0, 1}));
  };
  same([&](Mask& m) { EXPECT_EQ(keep_important(importance, 2, m), 2u); },
       [&](Mask& m) { EXPECT_EQ(keep_important(importance, 2, m, threads), 2u); });
  same([&](Mask& m) { keep_weighted_sample(priorities, 1, stream(2), m); },
       [&](Mask& m) { keep_weighted_sample(priorities, 1, stream(2), m, threads); });
  same([&](Mask& m) { keep_largest(priorities, 2, m); }, [&](Mask& m) { keep_largest(priorities, 2, m, threads); });
  Mask all(4, 1);
  EXPECT_EQ(spare_one(priorities, all, threads), 3u);
  EXPECT_EQ(all, (Mask{1, 1, 1, 0}));
}

TEST(GrowthPriority, IsRelativeToTheThresholdWhereThereIsOne) {
  EXPECT_EQ(growth_priority(6, 2), 3);
  EXPECT_EQ(growth_priority(6, 0), 6);
}

TEST(SpareOne, SparesTheLargestOnlyIfAllWouldGo) {
  const std::vector<float> priorities{1, 7, 7, 2};
  Mask all(4, 1);
  EXPECT_EQ(spare_one(priorities, all), 3u);
  EXPECT_EQ(normalized(all), (Mask{1, 0, 1, 1}));
  Mask some{1, 1, 0, 1};
  EXPECT_EQ(spare_one(priorities, some), 3u);
  EXPECT_EQ(normalized(some), (Mask{1, 1, 0, 1}));
  Mask none(4, 0);
  EXPECT_EQ(spare_one(priorities, none), 0u);
  EXPECT_EQ(none, Mask(4, 0));
  Mask single(1, 1);
  EXPECT_EQ(spare_one(std::vector<float>{0}, single), 0u);
  EXPECT_EQ(single[0], 0);
  EXPECT_EQ(spare_one({}, {}), 0u);
}

TEST(SelectLeast, SelectsTheShareOfTheSmallest) {
  const std::vector<double> weights{5, 1, 0, 2, 40, 2, 50};  // sum 100
  const auto selected = [&](double share, Mask removals) {
    select_least(weights, share, removals);
    return removals;
  };
  EXPECT_EQ(selected(0, Mask(7, 0)), Mask(7, 0));
  EXPECT_EQ(selected(0.03, Mask(7, 0)), (Mask{0, 1, 0, 1, 0, 0, 0})) << "of equals the first";
  EXPECT_EQ(selected(0.099, Mask(7, 0)), (Mask{0, 1, 0, 1, 0, 1, 0})) << "the next would be more than the share";
  EXPECT_EQ(selected(0.1, Mask(7, 0)), (Mask{1, 1, 0, 1, 0, 1, 0})) << "weight 0 was seen by nobody, and stays";
  EXPECT_EQ(selected(0.03, Mask{0, 1, 0, 0, 0, 0, 1}), (Mask{0, 1, 0, 1, 0, 0, 1}))
      << "what goes anyway is not charged";
  Mask none;
  select_least({}, 0.5, none);
  EXPECT_THROW(select_least(weights, 0.5, none), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test

// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "splatboost/schedule.h"

namespace splatboost::test {
namespace {

int steps_between(const StepIntervals& intervals, int total, int first, int last) {
  int steps = 0;
  for (int iteration = first; iteration <= last; ++iteration) steps += steps_at(intervals, {iteration, total}) ? 1 : 0;
  return steps;
}

TEST(ScaledIteration, KeepsProportions) {
  EXPECT_EQ(scaled_iteration(15000, 30000), 15000);
  EXPECT_EQ(scaled_iteration(15000, 3000), 1500);
  EXPECT_EQ(scaled_iteration(600, 7000), 140);
  EXPECT_EQ(scaled_iteration(500, 60000), 1000);
  EXPECT_EQ(scaled_iteration(std::numeric_limits<int>::max(), 60000), std::numeric_limits<int>::max()) << "never";
  EXPECT_EQ(scaled_iteration(500, 10000, 10000), 500) << "a method whose published run is shorter";
  EXPECT_EQ(scaled_iteration(8000, 3000, 10000), 2400);
  for (const int total : {1, 2, 7, 999, 7000, 30000, 100001}) {
    EXPECT_EQ(scaled_iteration(30000, total), total);
    EXPECT_EQ(scaled_iteration(1, total), std::max(1, static_cast<int>(std::lround(total / 30000.0))));
    int last = 0;
    for (int published = 1; published <= 30000; published += 113) {
      const int scaled = scaled_iteration(published, total);
      EXPECT_GE(scaled, 1);
      EXPECT_LE(scaled, total);
      EXPECT_GE(scaled, last);
      EXPECT_LE(std::abs(scaled - published * (total / 30000.0)), 1.0);
      last = scaled;
    }
  }
}

TEST(ScaledIteration, DoesNotOverflow) { EXPECT_EQ(scaled_iteration(15000, 2000000), 1000000); }

TEST(StepsAt, EveryIterationByDefault) {
  // Also in runs longer than the published one: an interval of 1 is not scaled.
  for (const int total : {1, 10, 3000, 30000, 60000}) EXPECT_EQ(steps_between({}, total, 1, total), total) << total;
}

TEST(StepsAt, FollowsThePapersPlan) {
  const StepIntervals rest{16, 32, 64, 15000, 20000};
  EXPECT_NEAR(steps_between(rest, 30000, 1, 15000), 15000 / 16, 1);
  EXPECT_NEAR(steps_between(rest, 30000, 15001, 20000), 5000 / 32, 1);
  EXPECT_NEAR(steps_between(rest, 30000, 20001, 30000), 10000 / 64, 2);
  const StepIntervals all{1, 32, 64, 15000, 20000};
  EXPECT_EQ(steps_between(all, 30000, 1, 15000), 15000);
  EXPECT_NEAR(steps_between(all, 30000, 15001, 20000), 5000 / 32, 1);
  // Steps are never farther apart than the interval.
  int last = 0;
  for (int iteration = 1; iteration <= 30000; ++iteration) {
    if (!steps_at(rest, {iteration, 30000})) continue;
    EXPECT_LE(iteration - last, iteration <= 15000 ? 16 : iteration <= 20000 ? 32 : 64) << iteration;
    last = iteration;
  }
  EXPECT_EQ(last, 30000);
}

TEST(StepsAt, PhasesScaleWithTheRun) {
  const StepIntervals intervals{1, 1000000000, 1, 15000, 20000};
  EXPECT_EQ(steps_between(intervals, 3000, 1, 1500), 1500);
  EXPECT_EQ(steps_between(intervals, 3000, 1501, 2000), 0);
  EXPECT_EQ(steps_between(intervals, 3000, 2001, 3000), 1000);
}

TEST(StepsAt, PhasesAreOfThePublishedRunOfTheMethod) {
  const StepIntervals intervals{1, 1000000000, 1, 15000, 20000};
  for (int iteration = 1; iteration <= 40000; ++iteration) {
    const bool expected = iteration <= 15000 || iteration > 20000;
    ASSERT_EQ(steps_at(intervals, {iteration, 40000}, 40000), expected) << iteration;
    ASSERT_EQ(steps_literally_at(intervals, {iteration, 40000}, 40000), expected) << iteration;
  }
}

TEST(StepsAt, IntervalsOfAShortRunScaleWithItsCube) {
  const StepIntervals rest{16, 32, 64, 15000, 20000};
  EXPECT_NEAR(steps_between(rest, 15000, 1, 7500), 7500 / 2, 1);
  EXPECT_NEAR(steps_between(rest, 15000, 7501, 10000), 2500 / 4, 1);
  EXPECT_NEAR(steps_between(rest, 15000, 10001, 15000), 5000 / 8, 2);
}

TEST(StepsAt, IntervalsNeverExceedThePublishedOnes) {
  const StepIntervals rest{16, 32, 64, 15000, 20000};
  EXPECT_NEAR(steps_between(rest, 60000, 1, 30000), 30000 / 16, 1);
  EXPECT_NEAR(steps_between(rest, 60000, 30001, 40000), 10000 / 32, 1);
  EXPECT_NEAR(steps_between(rest, 60000, 40001, 60000), 20000 / 64, 2);
}

TEST(StepsAt, AnIntervalBelowOneCountsAsOne) {
  const StepIntervals intervals{0, -3, 1, 15000, 20000};
  for (const int iteration : {7, 16000, 25001}) {
    EXPECT_TRUE(steps_at(intervals, {iteration, 30000}));
    EXPECT_TRUE(steps_literally_at(intervals, {iteration, 30000}));
  }
}

TEST(StepsAt, TheLastIterationAlwaysSteps) {
  for (const int total : {1, 5, 17, 1000, 29999}) {
    EXPECT_TRUE(steps_at({1000000, 1000000, 1000000, 15000, 20000}, {total, total})) << total;
  }
}

TEST(ExponentialRate, IsLogLinear) {
  EXPECT_DOUBLE_EQ(exponential_rate(1.6e-4, 1.6e-6, 0, 30000), 1.6e-4);
  EXPECT_NEAR(exponential_rate(1.6e-4, 1.6e-6, 15000, 30000), 1.6e-5, 1e-17);
  EXPECT_NEAR(exponential_rate(1.6e-4, 1.6e-6, 30000, 30000), 1.6e-6, 1e-18);
  EXPECT_NEAR(exponential_rate(1.6e-4, 1.6e-6, 90000, 30000), 1.6e-6, 1e-18);
  EXPECT_NEAR(exponential_rate(1.6e-4, 1.6e-6, 7500, 30000), 1.6e-4 * std::pow(0.01, 0.25), 1e-16);
  for (int iteration = 1; iteration <= 100; ++iteration) {
    EXPECT_LT(exponential_rate(1, 0.1, iteration, 100), exponential_rate(1, 0.1, iteration - 1, 100));
    EXPECT_DOUBLE_EQ(exponential_rate(0.3, 0.3, iteration, 100), 0.3);
  }
}

TEST(AveragesAt, EvenlySpacedIterationsOfTheEndOfTheRunAndItsLast) {
  const auto of_run = [](double share, int total) {
    std::vector<int> iterations;
    for (int i = 1; i <= total; ++i) {
      if (averages_at(share, {i, total})) iterations.push_back(i);
    }
    return iterations;
  };
  EXPECT_EQ(of_run(0.05, 100), (std::vector<int>{96, 97, 98, 99, 100}));
  const std::vector<int> published = of_run(0.05, 30000);
  ASSERT_EQ(published.size(), 63u);
  EXPECT_GT(published.front(), 28500);
  EXPECT_EQ(published.back(), 30000);
  for (std::size_t k = 1; k < published.size(); ++k) EXPECT_EQ(published[k] - published[k - 1], 24);
  EXPECT_TRUE(of_run(0, 100).empty());
  EXPECT_TRUE(of_run(0.05, 19).empty()) << "less than one iteration";
  EXPECT_EQ(of_run(0.05, 20), (std::vector<int>{20}));
}

}  // namespace
}  // namespace splatboost::test

// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "splatboost/scores.h"

namespace splatboost::test {
namespace {

using Counts = std::vector<std::int32_t>;

std::vector<std::int64_t> importance(const ScoreSums& sums) {
  std::vector<std::int64_t> scores(sums.counts.size(), -1);
  importance_scores(sums, scores);
  Threads threads(1);
  std::vector<std::int64_t> of_a_device(scores.size(), -1);
  importance_scores(sums.counts, sums.views, of_a_device, threads);
  EXPECT_EQ(of_a_device, scores);
  return scores;
}

std::vector<float> pruning(const ScoreSums& sums) {
  std::vector<float> scores(sums.counts.size(), -1);
  pruning_scores(sums, scores);
  Threads threads(1);
  std::vector<float> of_a_device(scores.size(), -1);
  pruning_scores(sums.weighted_counts, of_a_device, threads);
  EXPECT_EQ(of_a_device, scores);
  return scores;
}

TEST(Scores, AreMeansRoundedDownAndWeightedSums) {
  ScoreSums sums;
  sums.reset(4);
  sums.add_view(Counts{0, 10, 5, 1}, 0.5);
  sums.add_view(Counts{0, 7, 6, 0}, 0.25);
  sums.add_view(Counts{2, 0, 6, 0}, 1.0);
  EXPECT_EQ(sums.views, 3);
  EXPECT_EQ(sums.counts, (std::vector<std::int64_t>{2, 17, 17, 1}));
  EXPECT_EQ(importance(sums), (std::vector<std::int64_t>{0, 5, 5, 0}));  // 0.67, 5.67, 5.67, 0.33
  // x = 2, 6.75, 10, 0.5
  const auto scores = pruning(sums);
  EXPECT_FLOAT_EQ(scores[0], 1.5f / 9.5f);
  EXPECT_FLOAT_EQ(scores[1], 6.25f / 9.5f);
  EXPECT_EQ(scores[2], 1);
  EXPECT_EQ(scores[3], 0);
}

TEST(Scores, OneViewIsItsOwnMean) {
  ScoreSums sums;
  sums.reset(3);
  sums.add_view(Counts{6, 5, 0}, 0.1);
  EXPECT_EQ(importance(sums), (std::vector<std::int64_t>{6, 5, 0}));
  const auto scores = pruning(sums);
  EXPECT_EQ(scores[0], 1);
  EXPECT_FLOAT_EQ(scores[1], 5.0f / 6.0f);
  EXPECT_EQ(scores[2], 0);
}

TEST(Scores, EqualSumsGiveZeroNeverNan) {
  ScoreSums sums;
  sums.reset(3);
  EXPECT_EQ(pruning(sums), (std::vector<float>{0, 0, 0}));  // without views
  EXPECT_EQ(importance(sums), (std::vector<std::int64_t>{0, 0, 0}));
  sums.add_view(Counts{0, 0, 0}, 0.3);
  EXPECT_EQ(pruning(sums), (std::vector<float>{0, 0, 0}));
  sums.add_view(Counts{4, 4, 4}, 0.3);
  EXPECT_EQ(pruning(sums), (std::vector<float>{0, 0, 0}));
  sums.add_view(Counts{1, 2, 3}, 0.0);  // a view without loss has weight 0
  EXPECT_EQ(pruning(sums), (std::vector<float>{0, 0, 0}));
}

TEST(Scores, OnePrimitiveHasNothingToCompareWith) {
  ScoreSums sums;
  sums.reset(1);
  sums.add_view(Counts{12}, 0.7);
  EXPECT_EQ(pruning(sums), (std::vector<float>{0}));
  EXPECT_EQ(importance(sums), (std::vector<std::int64_t>{12}));
}

TEST(Scores, NoPrimitivesAreFine) {
  ScoreSums sums;
  sums.reset(0);
  sums.add_view({}, 0.7);
  EXPECT_TRUE(pruning(sums).empty());
  EXPECT_TRUE(importance(sums).empty());
}

TEST(Scores, ResetForgets) {
  ScoreSums sums;
  sums.reset(2);
  sums.add_view(Counts{9, 1}, 0.7);
  sums.reset(3);
  EXPECT_EQ(sums.views, 0);
  EXPECT_EQ(sums.counts, (std::vector<std::int64_t>{0, 0, 0}));
  EXPECT_EQ(sums.weighted_counts, (std::vector<double>{0, 0, 0}));
}

// A primitive's score is the same whichever others are scored with it, as in blocks of one scene.
TEST(Scores, AbsoluteScoresDoNotDependOnOtherPrimitives) {
  const auto absolute = [](const Counts& counts) {
    ScoreSums sums;
    sums.reset(counts.size());
    sums.add_view(counts, 0.5);
    sums.weighted_pixels = 0.5 * 40;
    std::vector<float> scores(counts.size(), -1);
    absolute_pruning_scores(sums, scores);
    return scores;
  };
  EXPECT_EQ(absolute({10, 0, 40}), (std::vector<float>{0.25f, 0, 1}));
  EXPECT_EQ(absolute({10}), (std::vector<float>{0.25f}));
  ScoreSums none;
  none.reset(2);
  none.weighted_pixels = 1;
  none.reset(2);
  std::vector<float> scores(2, -1);
  absolute_pruning_scores(none, scores);
  EXPECT_EQ(scores, (std::vector<float>{0, 0})) << "nothing is flagged: 0, never NaN";
}

TEST(Scores, SumsExceedThirtyTwoBits) {
  ScoreSums sums;
  sums.reset(2);
  for (int view = 0; view < 4; ++view) sums.add_view(Counts{2000000000, 0}, 1);
  EXPECT_EQ(sums.counts[0], 8000000000);
  EXPECT_EQ(importance(sums)[0], 2000000000);
}

// Scores are normalised by the range of the sums: a common factor of the losses cancels.
TEST(Scores, PruningIgnoresTheScaleOfTheLosses) {
  ScoreSums a;
  ScoreSums b;
  a.reset(4);
  b.reset(4);
  for (int view = 0; view < 5; ++view) {
    const Counts counts{view, 3 * view + 1, 7, (view * view) % 5};
    a.add_view(counts, 0.1 + 0.05 * view);
    b.add_view(counts, 1e-6 * (0.1 + 0.05 * view));
  }
  const auto scores_a = pruning(a);
  const auto scores_b = pruning(b);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_FLOAT_EQ(scores_a[i], scores_b[i]);
}

}  // namespace
}  // namespace splatboost::test

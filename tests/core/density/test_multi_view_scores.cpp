// SPDX-License-Identifier: Apache-2.0
// Scoring over views, with a fake backbone.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

#include "reference/photometric.h"
#include "splatboost/blending_weights.h"
#include "splatboost/errors.h"
#include "splatboost/multi_view_scores.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

/// Three primitives: the first is blended in every flagged pixel, the second in the left half, the third nowhere.
class Cardboard : public RasterizerHook {
 public:
  explicit Cardboard(std::size_t views) {
    Numbers random(5);
    for (std::size_t v = 0; v < views; ++v) {
      colors_.emplace_back();
      truths_.emplace_back();
      for (int k = 0; k < 3 * kWidth * kHeight; ++k) {
        colors_[v].push_back(random.real(0, 1));
        truths_[v].push_back(static_cast<std::uint8_t>(random.bits() % 256));
      }
    }
  }

  void set_beta(std::optional<float>) override {}
  std::size_t primitives() const override { return 3; }
  std::size_t scorable_views() const override { return colors_.size(); }
  ScoredView render_for_score(std::size_t view) override {
    rendered.push_back(view);
    return {colors_.at(view), {kWidth, kHeight, truths_.at(view), {}}};
  }
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    ASSERT_EQ(flagged.size(), static_cast<std::size_t>(kWidth * kHeight));
    ASSERT_EQ(counts.size(), 3u);
    for (std::size_t p = 0; p < flagged.size(); ++p) {
      counts[0] += flagged[p] != 0 ? 1 : 0;
      counts[1] += flagged[p] != 0 && p % kWidth < kWidth / 2 ? 1 : 0;
    }
  }

  void add_weights(std::span<std::int32_t> weights) override {
    weights[0] += 10;
    if (rendered.back() % 2 == 0) weights[1] += static_cast<std::int32_t>(rendered.back());
  }

  /// What the sums should be over some views.
  void expect(const ScoreSums& sums, const std::vector<std::size_t>& views, double tau, double lambda) const {
    std::int64_t counts[3] = {0, 0, 0};
    double weighted[3] = {0, 0, 0};
    for (const std::size_t v : views) {
      reference::ImagePair pair{kWidth, kHeight, {colors_[v].begin(), colors_[v].end()}, {}, {}};
      for (const std::uint8_t byte : truths_[v]) pair.truth.push_back(byte / 255.0);
      const double loss = reference::photometric(pair, lambda).total;
      const auto map = reference::error_map(pair);
      std::int64_t n[3] = {0, 0, 0};
      for (std::size_t p = 0; p < map.normalized.size(); ++p) {
        ASSERT_GT(std::abs(map.normalized[p] - tau), 1e-6);  // no pixel is at the threshold
        n[0] += map.normalized[p] > tau ? 1 : 0;
        n[1] += map.normalized[p] > tau && p % kWidth < kWidth / 2 ? 1 : 0;
      }
      for (int i = 0; i < 3; ++i) {
        counts[i] += n[i];
        weighted[i] += loss * static_cast<double>(n[i]);
      }
    }
    EXPECT_EQ(sums.views, static_cast<int>(views.size()));
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(sums.counts[i], counts[i]);
      EXPECT_NEAR(sums.weighted_counts[i], weighted[i], 1e-5 * (1 + weighted[i]));
    }
    EXPECT_NEAR(sums.weighted_pixels, weighted[0], 1e-5 * (1 + weighted[0]));
    EXPECT_GT(counts[1], 0);
    EXPECT_GT(counts[0], counts[1]);
  }

  static constexpr int kWidth = 30;
  static constexpr int kHeight = 20;
  std::vector<std::size_t> rendered;

 private:
  std::vector<std::vector<float>> colors_;
  std::vector<std::vector<std::uint8_t>> truths_;
};

TEST(MultiViewScorer, ScoresKDifferentViewsOnce) {
  Threads threads(2);
  MultiViewScorer scorer(threads);
  Cardboard backbone(25);
  const ScoreSums& sums = scorer.score(backbone, {.views = 10, .tau = 0.3f, .lambda_dssim = 0.2f},
                                       RandomStream(1, 600, RandomPurpose::scored_views));
  EXPECT_EQ(backbone.rendered.size(), 10u);
  EXPECT_EQ(std::set<std::size_t>(backbone.rendered.begin(), backbone.rendered.end()).size(), 10u);
  backbone.expect(sums, backbone.rendered, 0.3f, 0.2f);
  EXPECT_DOUBLE_EQ(scorer.mean_pixels(), 600);
  EXPECT_DOUBLE_EQ(scorer.covered_share(), 1);  // noise against noise: every pixel has an error
}

TEST(MultiViewScorer, TakesWhatThereIs) {
  Threads threads(1);
  MultiViewScorer scorer(threads);
  Cardboard backbone(4);
  const RandomStream random(2, 600, RandomPurpose::scored_views);
  const ScoreSums& sums = scorer.score(backbone, {}, random);
  std::vector<std::size_t> views = backbone.rendered;
  backbone.expect(sums, views, 0.1f, 0.2f);
  std::sort(views.begin(), views.end());
  EXPECT_EQ(views, (std::vector<std::size_t>{0, 1, 2, 3}));
  // Another call starts from zero sums.
  const ScoreSums& again = scorer.score(backbone, {}, random);
  EXPECT_EQ(again.views, 4);
  backbone.expect(again, {0, 1, 2, 3}, 0.1f, 0.2f);
  Cardboard none(0);
  EXPECT_EQ(scorer.score(none, {}, random).views, 0);
}

TEST(MultiViewScorer, CountsTheSameWithoutLosses) {
  Threads threads(2);
  MultiViewScorer scorer(threads);
  Cardboard backbone(6);
  const RandomStream random(3, 600, RandomPurpose::scored_views);
  const ScoreSums with = scorer.score(backbone, {.views = 4}, random);
  const double share = scorer.covered_share();
  const ScoreSums& without = scorer.score(backbone, {.views = 4, .losses = false}, random);
  EXPECT_EQ(without.views, with.views);
  EXPECT_EQ(without.counts, with.counts);
  EXPECT_EQ(scorer.covered_share(), share);
  EXPECT_TRUE(without.weighted_counts.empty());
  std::vector<float> scores(3);
  EXPECT_THROW(pruning_scores(without, scores), ArgumentError);  // no weighted counts
}

TEST(DrawViews, DrawsWithoutReplacementAndFairly) {
  std::vector<int> first(6, 0);
  std::vector<int> included(6, 0);
  const int trials = 12000;
  for (int trial = 0; trial < trials; ++trial) {
    const auto views =
        draw_views(6, 3, RandomStream(7, static_cast<std::uint64_t>(trial), RandomPurpose::scored_views));
    ASSERT_EQ(views.size(), 3u);
    ASSERT_EQ(std::set<std::size_t>(views.begin(), views.end()).size(), 3u);
    ++first[views[0]];
    for (const std::size_t view : views) {
      ASSERT_LT(view, 6u);
      ++included[view];
    }
  }
  for (std::size_t v = 0; v < 6; ++v) {
    EXPECT_NEAR(first[v], trials / 6, 5 * std::sqrt(trials * 5.0 / 36));
    EXPECT_NEAR(included[v], trials / 2, 5 * std::sqrt(trials / 4.0));
  }
  EXPECT_TRUE(draw_views(0, 3, RandomStream(7, 1, RandomPurpose::scored_views)).empty());
  EXPECT_EQ(draw_views(2, 9, RandomStream(7, 1, RandomPurpose::scored_views)).size(), 2u);
}

TEST(BlendingWeights, AreMeansOverTheViewsWithAny) {
  Threads threads(1);
  BlendingWeights weights(threads);
  Cardboard backbone(8);
  const RandomStream random(3, 600, RandomPurpose::scored_views);
  const auto means = weights.mean(backbone, 50, random);
  EXPECT_EQ(backbone.rendered.size(), 8u);
  EXPECT_EQ(std::vector<double>(means.begin(), means.end()),
            (std::vector<double>{10, 4, 0}));  // 4 is the mean of 2, 4 and 6: view 0 has weight 0
  backbone.rendered.clear();
  EXPECT_DOUBLE_EQ(weights.mean(backbone, 3, random)[0], 10) << "sums start anew";
  EXPECT_EQ(backbone.rendered.size(), 3u);
}

}  // namespace
}  // namespace splatboost::test

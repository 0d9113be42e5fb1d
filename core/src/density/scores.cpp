// SPDX-License-Identifier: Apache-2.0
#include "splatboost/scores.h"

#include <algorithm>

#include "density/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {

void ScoreSums::reset(std::size_t primitives, bool losses) {
  views = 0;
  weighted_pixels = 0;
  counts.assign(primitives, 0);
  weighted_counts.assign(losses ? primitives : 0, 0.0);
}

void ScoreSums::add_view(std::span<const std::int32_t> view_counts, double photometric_loss) {
  SPLATBOOST_CHECK(view_counts.size() == counts.size(), "a view's counts must have one number per primitive");
  ++views;
  for (std::size_t i = 0; i < view_counts.size(); ++i) counts[i] += view_counts[i];
  for (std::size_t i = 0; i < weighted_counts.size(); ++i) {
    weighted_counts[i] += photometric_loss * static_cast<double>(view_counts[i]);
  }
}

namespace {

void importance_on_host(std::span<const std::int64_t> counts, int views, std::span<std::int64_t> scores) {
  SPLATBOOST_CHECK(scores.size() == counts.size(), "scores must have one number per primitive");
  for (std::size_t i = 0; i < scores.size(); ++i) scores[i] = views > 0 ? counts[i] / views : 0;
}

void pruning_on_host(std::span<const double> weighted_counts, std::span<float> scores) {
  SPLATBOOST_CHECK(scores.size() == weighted_counts.size(), "scores must have one number per primitive");
  if (scores.empty()) return;
  const auto [low, high] = std::minmax_element(weighted_counts.begin(), weighted_counts.end());
  const double range = *high - *low;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    scores[i] = range > 0 ? static_cast<float>((weighted_counts[i] - *low) / range) : 0.0f;
  }
}

}  // namespace

void importance_scores(const ScoreSums& sums, std::span<std::int64_t> scores) {
  importance_on_host(sums.counts, sums.views, scores);
}

void pruning_scores(const ScoreSums& sums, std::span<float> scores) { pruning_on_host(sums.weighted_counts, scores); }

void absolute_pruning_scores(const ScoreSums& sums, std::span<float> scores) {
  SPLATBOOST_CHECK(scores.size() == sums.weighted_counts.size(), "scores must have one number per primitive");
  const double all = sums.weighted_pixels;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    scores[i] = all > 0 ? static_cast<float>(sums.weighted_counts[i] / all) : 0.0f;
  }
}

void importance_scores(std::span<const std::int64_t> counts, int views, std::span<std::int64_t> scores, Device device) {
  if (!device.is_cuda()) return importance_on_host(counts, views, scores);
  SPLATBOOST_CHECK(scores.size() == counts.size(), "scores must have one number per primitive");
  cuda::importance_scores(counts, views, scores, device.stream());
}

void pruning_scores(std::span<const double> weighted_counts, std::span<float> scores, Device device) {
  if (!device.is_cuda()) return pruning_on_host(weighted_counts, scores);
  SPLATBOOST_CHECK(scores.size() == weighted_counts.size(), "scores must have one number per primitive");
  cuda::pruning_scores(weighted_counts, scores, device.stream());
}

}  // namespace splatboost

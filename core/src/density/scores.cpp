// SPDX-License-Identifier: Apache-2.0
#include "splatboost/scores.h"

#include <algorithm>

#include "density/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {

void ScoreSums::reset(std::size_t primitives, bool losses) {
  views = 0;
  counts.assign(primitives, 0);
  weighted_counts.assign(losses ? primitives : 0, 0.0);
}

void ScoreSums::add_view(std::span<const std::int32_t> view_counts, double photometric_loss) {
  SPLATBOOST_CHECK(view_counts.size() == counts.size(), "a view's counts must have one number a primitive");
  ++views;
  for (std::size_t i = 0; i < view_counts.size(); ++i) counts[i] += view_counts[i];
  for (std::size_t i = 0; i < weighted_counts.size(); ++i) {
    weighted_counts[i] += photometric_loss * static_cast<double>(view_counts[i]);
  }
}

void importance_scores(const ScoreSums& sums, std::span<std::int64_t> scores) {
  SPLATBOOST_CHECK(scores.size() == sums.counts.size(), "scores must have one number a primitive");
  for (std::size_t i = 0; i < scores.size(); ++i) scores[i] = sums.views > 0 ? sums.counts[i] / sums.views : 0;
}

void pruning_scores(const ScoreSums& sums, std::span<float> scores) {
  SPLATBOOST_CHECK(scores.size() == sums.weighted_counts.size(), "scores must have one number a primitive");
  if (scores.empty()) return;
  const auto [low, high] = std::minmax_element(sums.weighted_counts.begin(), sums.weighted_counts.end());
  const double range = *high - *low;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    scores[i] = range > 0 ? static_cast<float>((sums.weighted_counts[i] - *low) / range) : 0.0f;
  }
}

void importance_scores(std::span<const std::int64_t> counts, int views, std::span<std::int64_t> scores,
                       CudaStream& stream) {
  SPLATBOOST_CHECK(scores.size() == counts.size(), "scores must have one number a primitive");
  cuda::importance_scores(counts, views, scores, stream);
}

void pruning_scores(std::span<const double> weighted_counts, std::span<float> scores, CudaStream& stream) {
  SPLATBOOST_CHECK(scores.size() == weighted_counts.size(), "scores must have one number a primitive");
  cuda::pruning_scores(weighted_counts, scores, stream);
}

}  // namespace splatboost

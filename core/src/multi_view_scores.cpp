// SPDX-License-Identifier: Apache-2.0
#include "splatboost/multi_view_scores.h"

#include <algorithm>
#include <numeric>

#include "splatboost/error_map.h"
#include "splatboost/errors.h"

namespace splatboost {

std::vector<std::size_t> draw_views(std::size_t n, int k, const RandomStream& random) {
  SPLATBOOST_CHECK(k > 0, "the number of scored views must be above 0");
  std::vector<std::size_t> views(n);
  std::iota(views.begin(), views.end(), std::size_t{0});
  const std::size_t drawn = std::min(n, static_cast<std::size_t>(k));
  for (std::size_t i = 0; i < drawn; ++i) std::swap(views[i], views[i + random.below(i, n - i)]);
  views.resize(drawn);
  return views;
}

MultiViewScorer::MultiViewScorer(Threads& threads) : threads_(threads), photometric_(threads) {}

const ScoreSums& MultiViewScorer::score(RasterizerHook& rasterizer, const MultiViewOptions& options,
                                        const RandomStream& random) {
  const std::size_t primitives = rasterizer.primitives();
  sums_.reset(primitives);
  double pixels_sum = 0, valid = 0, covered = 0;
  for (const std::size_t index : draw_views(rasterizer.scorable_views(), options.views, random)) {
    const ScoredView view = rasterizer.render_for_score(index);
    const std::size_t pixels = static_cast<std::size_t>(view.truth.width) * static_cast<std::size_t>(view.truth.height);
    error_.resize(pixels);
    flagged_.resize(pixels);
    flag_errors(view.color, view.truth, options.tau, error_, flagged_, threads_);
    const PhotometricLoss loss = photometric_.evaluate(view.color, view.truth, options.lambda_dssim, {});
    counts_.assign(primitives, 0);
    rasterizer.count_flagged(flagged_, counts_);
    sums_.add_view(counts_, loss.total);
    pixels_sum += static_cast<double>(pixels);
    for (std::size_t p = 0; p < pixels; ++p) {
      if (!view.truth.valid.empty() && view.truth.valid[p] == 0) continue;
      valid += 1;
      covered += error_[p] > kNoError ? 1 : 0;
    }
  }
  mean_pixels_ = sums_.views > 0 ? pixels_sum / sums_.views : 0;
  covered_share_ = valid > 0 ? covered / valid : 1;
  return sums_;
}

}  // namespace splatboost

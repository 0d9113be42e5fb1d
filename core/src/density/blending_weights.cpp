// SPDX-License-Identifier: Apache-2.0
#include "splatboost/blending_weights.h"

#include "splatboost/multi_view_scores.h"

namespace splatboost {

std::span<const double> BlendingWeights::mean(RasterizerHook& rasterizer, int views, const RandomStream& random) {
  const std::size_t n = rasterizer.primitives();
  mean_.assign(n, 0.0);
  seen_.assign(n, 0);
  for (const std::size_t view : draw_views(rasterizer.scorable_views(), views, random)) {
    rasterizer.render_for_score(view);
    view_weights_.assign_zeros(n);
    rasterizer.add_weights(view_weights_);
    const std::span<const std::int32_t> weights = view_weights_.on_host(copy_);
    for (std::size_t i = 0; i < n; ++i) {
      mean_[i] += weights[i];
      seen_[i] += weights[i] != 0 ? 1 : 0;
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (seen_[i] > 0) mean_[i] /= seen_[i];
  }
  return mean_;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "photo_slam/recent_views.h"

#include <algorithm>
#include <cmath>

#include "splatboost/multi_view_scores.h"

namespace splatboost {

std::vector<std::size_t> recent_and_drawn_views(std::size_t n, int k, double share, const RandomStream& random) {
  const std::size_t wanted = std::min(n, static_cast<std::size_t>(k));
  const std::size_t recent = std::min(wanted, static_cast<std::size_t>(std::lround(share * k)));
  std::vector<std::size_t> views;
  if (wanted > recent) views = draw_views(n - recent, static_cast<int>(wanted - recent), random);
  for (std::size_t i = n - recent; i < n; ++i) views.push_back(i);
  std::ranges::sort(views);
  return views;
}

ScoredView ChosenViews::render_for_score(std::size_t view) {
  const ScoredView scored = rasterizer_.render_for_score(views_[view]);
  pixels_ = static_cast<std::size_t>(scored.truth.width) * static_cast<std::size_t>(scored.truth.height);
  return scored;
}

void ChosenViews::count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) {
  rasterizer_.count_flagged(flagged, counts);
  if (ones_.size() != pixels_) ones_.assign(std::vector<std::uint8_t>(pixels_, 1));
  counts_.assign_zeros(seen_.size());
  rasterizer_.count_flagged(ones_, counts_);
  std::vector<std::int32_t> copy;
  const std::span<const std::int32_t> blended = counts_.on_host(copy);
  for (std::size_t i = 0; i < seen_.size(); ++i) seen_[i] += blended[i] > 0 ? 1 : 0;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "octree_gs/octree_adapter.h"

#include <algorithm>

#include "splatboost/array.h"

namespace splatboost {
namespace {

/// Passes everything on, and replays each scored view once more, with every pixel flagged, to see which anchors it
/// drew.
class AnchorViews final : public RasterizerHook {
 public:
  AnchorViews(RasterizerHook& inner, std::size_t slots, std::vector<std::int32_t>& views, Device device)
      : inner_(inner), slots_(slots), views_(views), all_(device), drawn_(device) {
    views_.assign(inner.primitives() / slots, 0);
  }
  void set_beta(std::optional<float> beta) override { inner_.set_beta(beta); }
  std::size_t primitives() const override { return inner_.primitives(); }
  std::size_t scorable_views() const override { return inner_.scorable_views(); }
  ScoredView render_for_score(std::size_t view) override { return inner_.render_for_score(view); }
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    inner_.count_flagged(flagged, counts);
    if (all_.size() != flagged.size()) all_.assign(std::vector<std::uint8_t>(flagged.size(), 1));
    drawn_.assign_zeros(counts.size());
    inner_.count_flagged(all_, drawn_);
    const std::span<const std::int32_t> drawn = drawn_.on_host(copy_);
    for (std::size_t a = 0; a < views_.size(); ++a) {
      const auto first = drawn.begin() + static_cast<std::ptrdiff_t>(slots_ * a);
      views_[a] += std::any_of(first, first + static_cast<std::ptrdiff_t>(slots_), [](auto n) { return n > 0; });
    }
  }

 private:
  RasterizerHook& inner_;
  std::size_t slots_;
  std::vector<std::int32_t>& views_;
  Array<std::uint8_t> all_;
  Array<std::int32_t> drawn_;
  std::vector<std::int32_t> copy_;  ///< of a GPU's
};

}  // namespace

void OctreeAdapter::score(RasterizerHook& rasterizer, const RandomStream& random,
                          std::vector<std::int64_t>& importance) {
  if (!boost_.level_aware) {
    ScaffoldAdapter::score(rasterizer, random, importance);
    return;
  }
  AnchorViews counted(rasterizer, boost_.slots_per_anchor, anchor_views_, device());
  const ScoreSums& found = sums(counted, random);
  importance.resize(found.counts.size());
  for (std::size_t i = 0; i < importance.size(); ++i) {
    importance[i] = found.counts[i] / std::max(anchor_views_[i / boost_.slots_per_anchor], kLeastViews);
  }
}

}  // namespace splatboost

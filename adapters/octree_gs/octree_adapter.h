// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for Octree-GS: Scaffold-GS's adapter, with a rule that knows that fine levels are in few views.
#pragma once

#include "scaffold_gs/scaffold_adapter.h"

namespace splatboost {

struct OctreeBoost : ScaffoldBoost {
  OctreeBoost() { mean_importance = 5; }  // counts over fewer views are larger

  /// Divide a slot's counts by the number of scored views that drew anything of its anchor, at least kLeastViews, in
  /// place of K: a fine anchor is out of most views for its level, not because it is good there. False: the paper's K,
  /// which starves fine levels (docs/results/backbones.md).
  bool level_aware = true;
  std::size_t slots_per_anchor = 10;  ///< k of the backbone
};

/// One view alone must not let a slot pass: importance is of several views.
inline constexpr int kLeastViews = 2;

class OctreeAdapter final : public ScaffoldAdapter {
 public:
  OctreeAdapter(const OctreeBoost& boost, Device device) : ScaffoldAdapter(boost, device), boost_(boost) {}

 private:
  void score(RasterizerHook& rasterizer, const RandomStream& random, std::vector<std::int64_t>& importance) override;

  OctreeBoost boost_;
  std::vector<std::int32_t> anchor_views_;  ///< [N] scored views that drew anything of each anchor
};

}  // namespace splatboost

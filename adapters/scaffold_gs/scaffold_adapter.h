// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for Scaffold-GS, whose primitives are (anchor, offset) slots: VCD gates the slots that would grow, CB
/// draws less. VCP does not apply: the anchor that a pruned Gaussian belongs to would make it anew.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "splatboost/device.h"
#include "splatboost/hooks.h"
#include "splatboost/multi_view_scores.h"

namespace splatboost {

/// The parts and constants of the method. The published runs step with Adam at every iteration: there is no schedule.
struct ScaffoldBoost {
  bool vcd = true;  ///< multi-view consistent densification
  bool cb = true;   ///< compact box
  float beta = 0.5f;
  double tau_d = 5;  ///< importance that growth must exceed; more where the mean exceeds mean_importance
  /// The paper's τ_d holds back the slots below the average of a model whose counted slots have this importance in the
  /// mean. Found on runs of 5 000 iterations.
  double mean_importance = 3.5;
  int views = 10;    ///< K
  float tau = 0.1f;  ///< error threshold
  std::uint64_t seed = 0;
};

/// Plug it into a backbone by set_hooks(&adapter, nullptr) after rasterizer_hook().set_beta(adapter.beta()).
class ScaffoldAdapter : public DensityHook {
 public:
  /// @param device the backbone's: where views are scored
  ScaffoldAdapter(const ScaffoldBoost& boost, Device device);

  /// β for the rasterizer, nullopt without the compact box.
  std::optional<float> beta() const;

  void grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) override;
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions&) override {}

 protected:
  /// Importance of every slot over K views: ⌊Σ counts / K⌋ (paper eq. 9).
  virtual void score(RasterizerHook& rasterizer, const RandomStream& random, std::vector<std::int64_t>& importance);

  /// τ_d in proportion to the mean importance of the slots that were counted at all, where that is above
  /// mean_importance: models that are young or of few, large Gaussians have errors under nearly every slot.
  double tau_d_for(std::span<const std::int64_t> importance) const;

  const ScoreSums& sums(RasterizerHook& rasterizer, const RandomStream& random);
  Device device() const { return device_; }

 private:
  ScaffoldBoost boost_;
  Device device_;
  MultiViewScorer scorer_;
  std::vector<std::int64_t> importance_;
};

}  // namespace splatboost

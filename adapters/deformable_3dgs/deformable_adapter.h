// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for Deformable-3DGS: vanilla's rules over its longer run. Primitives are the canonical Gaussians; the
/// backbone draws each scored view at its own time.
#pragma once

#include <cstdint>
#include <vector>

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Length of Deformable-3DGS's published run; it densifies until 15 000.
inline constexpr int kDeformableIterations = 40000;

/// Settings for a DeformableAdapter.
VanillaBoost deformable_boost();

class DeformableAdapter final : public VanillaAdapter {
 public:
  DeformableAdapter(const VanillaBoost& boost, Device device) : VanillaAdapter(boost, device) {}

  /// Within growth, removes all of the backbone's candidates with an opacity below kMinAlpha, which no pixel shows, and
  /// half of the others. The paper keeps half of all candidates; but the net evaluates every Gaussian for every view,
  /// and the 100 000 random points that a run may start from leave mostly invisible candidates.
  void prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) override;

  /// The net steps at every iteration: each view has its own time, and accumulating gradients over several views would
  /// leave too few steps. The schedule applies to the Gaussians only.
  bool steps_at(std::string_view group, Moment moment) const override;

 private:
  std::vector<std::uint8_t> unseen_;  ///< [N] 1 for candidates that no pixel shows
};

}  // namespace splatboost

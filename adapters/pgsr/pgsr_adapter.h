// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for PGSR: vanilla's rules on PGSR's own candidates. PGSR keeps its own trim and opacity resets.
#pragma once

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Settings for a PgsrAdapter. PGSR's own rules and thresholds select the candidates for growth and for removal.
VanillaBoost pgsr_boost();

/// The backbone renders scored views with exposure compensation, as it does in training.
class PgsrAdapter final : public VanillaAdapter {
 public:
  PgsrAdapter(const VanillaBoost& boost, Device device) : VanillaAdapter(boost, device) {}

  /// Of the backbone's candidates only: its screen radius and its cap on splits by absolute gradients hold with the
  /// literal thresholds too.
  void grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) override;
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for PGSR: vanilla's rules on PGSR's own candidates. Its trim and its resets of opacities stay its own.
#pragma once

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Settings for a PgsrAdapter. Candidates for growth and for removal are those of PGSR's rules, with its thresholds.
VanillaBoost pgsr_boost();

/// Views are scored with their exposure compensated, as they are trained; that is the backbone's part.
class PgsrAdapter final : public VanillaAdapter {
 public:
  PgsrAdapter(const VanillaBoost& boost, Device device) : VanillaAdapter(boost, device) {}
};

}  // namespace splatboost

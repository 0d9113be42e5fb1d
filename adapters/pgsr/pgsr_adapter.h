// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for PGSR: vanilla's rules. Its trim stays PGSR's own: a hook lets it go.
#pragma once

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Settings for a PgsrAdapter. Gradients and lengths are those of 3DGS; what PGSR grows by its large absolute gradients
/// on screen, the adapter decides by its own threshold. Candidates for removal are those of PGSR's rule alone, also its
/// opacity threshold.
VanillaBoost pgsr_boost();

/// Views are scored with their exposure compensated, as they are trained; that is the backbone's part.
class PgsrAdapter final : public VanillaAdapter {
 public:
  PgsrAdapter(const VanillaBoost& boost, Device device) : VanillaAdapter(boost, device) {}
};

}  // namespace splatboost

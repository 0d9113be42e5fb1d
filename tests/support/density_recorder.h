// SPDX-License-Identifier: Apache-2.0
/// @file Records the density decisions that a backbone makes by its own rules.
#pragma once

#include <cstdint>
#include <vector>

#include "splatboost/hooks.h"

namespace splatboost::testing {

/// The statistics passed to one call of the hook, and the backbone's own decisions before it.
struct DensityEvent {
  int iteration;
  bool growth;
  std::vector<float> gradients, gradients_abs, opacities, max_scales;
  std::vector<std::uint8_t> clone, split, remove;
  std::vector<std::uint32_t> origins;
  PruneRule rule = PruneRule::growth;  ///< of a call of prune()
};

/// Records every call without changing any decision.
class DensityRecorder : public DensityHook {
 public:
  void grow(const DensityStatistics& s, RasterizerHook&, GrowDecisions& d) override {
    DensityEvent e{s.moment.iteration, true, {}, {}, {}, {}, {}, {}, {}, {}};
    e.gradients.assign(s.gradients.begin(), s.gradients.end());
    e.gradients_abs.assign(s.gradients_abs.begin(), s.gradients_abs.end());
    e.max_scales.assign(s.max_scales.begin(), s.max_scales.end());
    e.opacities.assign(s.opacities.begin(), s.opacities.end());
    e.clone.assign(d.clone.begin(), d.clone.end());
    e.split.assign(d.split.begin(), d.split.end());
    events.push_back(e);
  }
  void prune(const DensityStatistics& s, RasterizerHook&, PruneDecisions& d) override {
    DensityEvent e{s.moment.iteration, false, {}, {}, {}, {}, {}, {}, {}, {}};
    e.max_scales.assign(s.max_scales.begin(), s.max_scales.end());
    e.opacities.assign(s.opacities.begin(), s.opacities.end());
    e.remove.assign(d.remove.begin(), d.remove.end());
    e.rule = d.rule;
    e.origins.assign(d.origins.begin(), d.origins.end());
    events.push_back(e);
  }
  std::vector<DensityEvent> events;
};

}  // namespace splatboost::testing

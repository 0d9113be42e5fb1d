// SPDX-License-Identifier: Apache-2.0
/// @file Multi-view consistent pruning (paper, supplement Sec. 9.1), from scores that an adapter has. Shared by the
/// adapters of Gaussians and of convexes.
#pragma once

#include <span>

#include "splatboost/density_statistics.h"
#include "splatboost/hooks.h"
#include "splatboost/random.h"

namespace splatboost {

/// Within growth: keeps half of the backbone's candidates as removals, drawn by the pruning scores of the primitives
/// that they were made from. Throws ArgumentError if `decisions` has no origins.
/// @param scores [primitives before growth]
void remove_half_of_candidates(std::span<const float> scores, const RandomStream& random, PruneDecisions& decisions);

/// Whether late pruning that began at iteration `begin` is due again: at the multiples of `interval`, but not shortly
/// before the end. Rounded, the tenth multiple of a tenth of a run may be due before its last iteration, where nothing
/// would be left to recover in.
bool late_pruning_recurs_at(Moment moment, int begin, int interval);

/// Late: also removes the primitives with a smaller opacity or a larger pruning score. Throws ArgumentError if
/// `statistics` has no opacities.
/// @param scores [primitives]
void remove_late(const DensityStatistics& statistics, std::span<const float> scores, float min_opacity, float max_score,
                 PruneDecisions& decisions);

}  // namespace splatboost

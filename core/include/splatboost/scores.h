// SPDX-License-Identifier: Apache-2.0
/// @file Multi-view consistency scores of primitives, from counts of flagged pixels (paper eqs. 9 and 11).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "splatboost/device.h"

namespace splatboost {

/// Sums over the scored views, one per primitive, in host memory. Owned by the caller, who can reuse them.
struct ScoreSums {
  int views = 0;                        ///< K, views added so far
  std::vector<std::int64_t> counts;     ///< [N] Σ_j n_ij
  std::vector<double> weighted_counts;  ///< [N] Σ_j E_j · n_ij; empty if reset() without losses
  double weighted_pixels = 0;           ///< Σ_j E_j · f_j, f_j: flagged pixels of view j; added by the caller

  void reset(std::size_t primitives, bool losses = true);
  /// Adds one view: its counts [N] and its photometric loss E_j, which is ignored if weighted_counts is empty.
  void add_view(std::span<const std::int32_t> view_counts, double photometric_loss);
};

/// Importance s⁺_i = ⌊Σ_j n_ij / K⌋ (paper eq. 9); 0 if no view was added.
/// @param scores [N]
void importance_scores(const ScoreSums& sums, std::span<std::int64_t> scores);

/// Pruning score s⁻_i = (x_i − min x) / (max x − min x), x_i = Σ_j E_j·n_ij (paper eq. 11); all 0 if all x are equal.
/// @param scores [N]
void pruning_scores(const ScoreSums& sums, std::span<float> scores);

/// Pruning score as a share of all errors, x_i / Σ_j E_j·f_j: 1 for a primitive in every flagged pixel; all 0 if no
/// pixel is flagged. Unlike min-max it does not depend on which other primitives exist. Not in the paper.
/// @param scores [N]
void absolute_pruning_scores(const ScoreSums& sums, std::span<float> scores);

// The same in the memory of a device.
/// @param counts [N] Σ_j n_ij over `views` views
void importance_scores(std::span<const std::int64_t> counts, int views, std::span<std::int64_t> scores, Device device);
/// @param weighted_counts [N] Σ_j E_j · n_ij, finite
void pruning_scores(std::span<const double> weighted_counts, std::span<float> scores, Device device);

}  // namespace splatboost

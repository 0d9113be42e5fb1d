// SPDX-License-Identifier: Apache-2.0
/// @file Adam, nearest neighbours and sampling probabilities, directly from their definitions, in double precision.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace splatboost::reference {

struct AdamState {
  std::vector<double> values;
  std::vector<double> first;
  std::vector<double> second;
};

/// One bias-corrected step (Kingma and Ba 2015); step counts from 1.
void adam_step(AdamState& state, const std::vector<double>& gradients, std::int64_t step, double learning_rate,
               double beta1, double beta2, double epsilon);

/// Mean squared distance of each point [N,3] to its k nearest others (to all others if there are fewer; 0 if N is 1).
std::vector<double> mean_squared_neighbor_distances(const std::vector<double>& points, int k);

/// Probability of each item to be among the first `keep` drawn successively without replacement, each with probability
/// proportional to its weight among those left. Weights must be positive. Enumerates all sequences: for few items only.
std::vector<double> inclusion_probabilities(const std::vector<double>& weights, std::size_t keep);

}  // namespace splatboost::reference

// SPDX-License-Identifier: Apache-2.0
#include "splatboost/select.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "density/cuda_ops.h"
#include "density/select_math.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

struct Ranked {
  double key;
  std::size_t index;
  bool operator<(const Ranked& other) const { return key < other.key || (key == other.key && index < other.index); }
};

/// Keeps the `keep` candidates with the smallest keys; of equal keys, the lower index comes first.
void keep_smallest(std::vector<Ranked>& ranked, std::size_t keep, std::span<std::uint8_t> candidates) {
  if (ranked.size() <= keep) return;
  std::nth_element(ranked.begin(), ranked.begin() + static_cast<std::ptrdiff_t>(keep), ranked.end());
  for (std::size_t i = keep; i < ranked.size(); ++i) candidates[ranked[i].index] = 0;
}

}  // namespace

std::size_t keep_important(std::span<const std::int64_t> importance, double threshold,
                           std::span<std::uint8_t> candidates) {
  SPLATBOOST_CHECK(importance.size() == candidates.size(), "importance and candidates must have the same size");
  std::size_t kept = 0;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    candidates[i] = is_important(candidates[i], importance[i], threshold);
    kept += candidates[i];
  }
  return kept;
}

void keep_weighted_sample(std::span<const float> weights, std::size_t keep, const RandomStream& random,
                          std::span<std::uint8_t> candidates) {
  SPLATBOOST_CHECK(weights.size() == candidates.size(), "weights and candidates must have the same size");
  std::vector<Ranked> ranked;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (candidates[i] == 0) continue;
    ranked.push_back({sample_key(weights[i], random.uniform(i)), i});
  }
  keep_smallest(ranked, keep, candidates);
}

void keep_largest(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> candidates) {
  SPLATBOOST_CHECK(priorities.size() == candidates.size(), "priorities and candidates must have the same size");
  std::vector<Ranked> ranked;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (candidates[i] == 0) continue;
    SPLATBOOST_CHECK(!std::isnan(priorities[i]), "priorities must not be NaN");
    ranked.push_back({priority_key(priorities[i]), i});
  }
  keep_smallest(ranked, keep, candidates);
}

void hold_cap(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> clone,
              std::span<std::uint8_t> split) {
  SPLATBOOST_CHECK(clone.size() == split.size(), "clone and split must have the same size");
  std::vector<std::uint8_t> growing(clone.size());
  for (std::size_t i = 0; i < growing.size(); ++i) growing[i] = clone[i] != 0 || split[i] != 0;
  keep_largest(priorities, keep, growing);
  for (std::size_t i = 0; i < growing.size(); ++i) {
    if (growing[i] == 0) clone[i] = split[i] = 0;
  }
}

std::size_t spare_one(std::span<const float> priorities, std::span<std::uint8_t> removals) {
  SPLATBOOST_CHECK(priorities.size() == removals.size(), "priorities and removals must have the same size");
  std::size_t removed = 0;
  for (const std::uint8_t r : removals) removed += r != 0;
  if (removals.empty() || removed < removals.size()) return removed;
  for (const float priority : priorities) SPLATBOOST_CHECK(!std::isnan(priority), "priorities must not be NaN");
  const auto best = std::max_element(priorities.begin(), priorities.end());
  removals[static_cast<std::size_t>(best - priorities.begin())] = 0;
  return removed - 1;
}

void select_least(std::span<const double> weights, double share, std::span<std::uint8_t> removals) {
  SPLATBOOST_CHECK(weights.size() == removals.size(), "weights and removals must have the same size");
  std::vector<Ranked> ranked;
  double sum = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    sum += weights[i];
    if (weights[i] > 0 && removals[i] == 0) ranked.push_back({weights[i], i});
  }
  std::sort(ranked.begin(), ranked.end());
  double selected = 0;
  for (const Ranked& next : ranked) {
    selected += next.key;
    if (selected > share * sum) break;
    removals[next.index] = 1;
  }
}

std::size_t keep_important(std::span<const std::int64_t> importance, double threshold,
                           std::span<std::uint8_t> candidates, Device device) {
  if (!device.is_cuda()) return keep_important(importance, threshold, candidates);
  SPLATBOOST_CHECK(importance.size() == candidates.size(), "importance and candidates must have the same size");
  return cuda::keep_important(importance, threshold, candidates, device.stream());
}

void keep_weighted_sample(std::span<const float> weights, std::size_t keep, const RandomStream& random,
                          std::span<std::uint8_t> candidates, Device device) {
  if (!device.is_cuda()) return keep_weighted_sample(weights, keep, random, candidates);
  SPLATBOOST_CHECK(weights.size() == candidates.size(), "weights and candidates must have the same size");
  cuda::keep_weighted_sample(weights, keep, random, candidates, device.stream());
}

void keep_largest(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> candidates,
                  Device device) {
  if (!device.is_cuda()) return keep_largest(priorities, keep, candidates);
  SPLATBOOST_CHECK(priorities.size() == candidates.size(), "priorities and candidates must have the same size");
  cuda::keep_largest(priorities, keep, candidates, device.stream());
}

std::size_t spare_one(std::span<const float> priorities, std::span<std::uint8_t> removals, Device device) {
  if (!device.is_cuda()) return spare_one(priorities, removals);
  SPLATBOOST_CHECK(priorities.size() == removals.size(), "priorities and removals must have the same size");
  return cuda::spare_one(priorities, removals, device.stream());
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for DropGaussian: vanilla's rules with constants for few views.
#pragma once

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Length of DropGaussian's published run, which it densifies to the end.
inline constexpr int kDropGaussianIterations = 10000;

/// Settings for a DropGaussianAdapter. K is min(10, views) as in all adapters, so with few views all are scored.
VanillaBoost dropgaussian_boost();

/// With few views, no other view contradicts a spurious gradient, so splitting needs stronger evidence. Its threshold
/// is the setting times 1 + kFewViewThresholdScale / views: 0.0024 for three views, 0.0018 for six, the paper's for
/// many. Ours, not the paper's, found on fern (docs/results/backbones.md).
inline constexpr double kFewViewThresholdScale = 3;

/// @param boost as for vanilla: its gradient_abs_threshold is the value for many views, and settings report it unscaled
class DropGaussianAdapter final : public VanillaAdapter {
 public:
  DropGaussianAdapter(const VanillaBoost& boost, Device device) : VanillaAdapter(boost, device) {}

 protected:
  double split_threshold(std::size_t views) const override;
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for DropGaussian: vanilla's rules with constants for few views.
#pragma once

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Length of DropGaussian's published run, which it densifies to the end.
inline constexpr int kDropGaussianIterations = 10000;

/// Settings for a VanillaAdapter. K is min(10, views) as everywhere, so all of a few views are scored.
VanillaBoost dropgaussian_boost();

}  // namespace splatboost

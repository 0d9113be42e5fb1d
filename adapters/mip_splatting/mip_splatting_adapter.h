// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for Mip-Splatting: vanilla's rules and constants, read from Mip-Splatting's statistics.
#pragma once

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Mip-Splatting adds the absolute gradients along x and y up, where AbsGS, whose threshold we have, takes the length
/// of the two. The sum is 1 (an edge along an axis) to √2 (no direction preferred) times the length; Gaussians near the
/// threshold have hardly a preferred direction: 1.35 to 1.39 on photos.
inline constexpr double kAbsoluteSumOverLength = 1.36;

/// @param boost as for vanilla: its gradient_abs_threshold is of AbsGS's length, and so is told in settings
/// DensityStatistics::gradients_abs must be Mip-Splatting's sums, opacities and scales those before its 3D filter.
class MipSplattingAdapter final : public VanillaAdapter {
 public:
  MipSplattingAdapter(const VanillaBoost& boost, Device device);
};

}  // namespace splatboost

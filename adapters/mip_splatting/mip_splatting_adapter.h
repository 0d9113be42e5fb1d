// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for Mip-Splatting: vanilla's rules and constants, read from Mip-Splatting's statistics.
#pragma once

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Mip-Splatting sums the absolute gradients along x and y; AbsGS, whose threshold we use, takes the length of that
/// vector. The sum is 1 (edge along an axis) to √2 (no preferred direction) times the length. Gaussians near the
/// threshold have hardly any preferred direction: 1.35 to 1.39 on photos.
inline constexpr double kAbsoluteSumOverLength = 1.36;

/// @param boost as for vanilla: its gradient_abs_threshold applies to AbsGS's length, and settings report it so
/// DensityStatistics::gradients_abs must hold Mip-Splatting's sums; opacities and scales those before its 3D filter.
class MipSplattingAdapter final : public VanillaAdapter {
 public:
  MipSplattingAdapter(const VanillaBoost& boost, Device device);
};

}  // namespace splatboost

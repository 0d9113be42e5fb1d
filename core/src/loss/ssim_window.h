// SPDX-License-Identifier: Apache-2.0
/// @file The window of structural similarity: 11×11, a Gaussian of σ 1.5.
#pragma once

namespace splatboost {

inline constexpr int kSsimRadius = 5;

/// Normalised, at -5 .. 5; symmetric, so the first half and the centre suffice.
inline constexpr float kSsimWindow[kSsimRadius + 1] = {0.00102838f, 0.00759876f, 0.03600077f,
                                                       0.10936069f, 0.21300554f, 0.26601172f};

}  // namespace splatboost

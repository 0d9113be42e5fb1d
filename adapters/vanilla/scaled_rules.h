// SPDX-License-Identifier: Apache-2.0
/// @file How the paper's constants follow the size of images and the number of visits of a view, where a run is not the
/// paper's. Of Gaussians and convexes alike; none of it is the paper's.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "splatboost/schedule.h"

namespace splatboost {

/// Images of the paper have about a megapixel. Importance counts pixels: below that, what growth asks for shrinks with
/// the area, down to one pixel a view, and the mean over views is compared without being cut to a whole number.
inline constexpr double kTauDPixels = 1e6;

/// What Σ_j n_ij must exceed.
/// @param wanted flagged pixels a view that growth asks for in images of the paper's size
/// @param pixels of a view
/// @param views K, those that were scored
inline double importance_to_exceed(double wanted, double pixels, int views) {
  const double least = std::max(1.0, wanted * std::min(1.0, pixels / kTauDPixels));
  return std::ceil(least * std::max(1, views)) - 1;
}

/// Iterations for each training view after which opacities have settled; the paper's runs have at least twice as many.
inline constexpr double kSettledVisits = 50;

/// 1, or in proportion less where views are seen fewer than kSettledVisits times. The opacity below which late pruning
/// takes a primitive shrinks with it: a run that sees its views fewer times leaves more primitives near the opacity
/// that all begin with, and needs them. So does the share of weights that goes when growth has ended, because what is
/// left has fewer visits to take the place of what went.
/// @param views the backbone's training views
inline double settled_share(Moment moment, std::size_t views) {
  const double visits = static_cast<double>(moment.total) / static_cast<double>(std::max<std::size_t>(views, 1));
  return std::min(1.0, visits / kSettledVisits);
}

/// Views that tell what they show of each primitive, once a run: as many as keep that below a hundredth of its time.
inline constexpr int kWeighedViews = 50;

}  // namespace splatboost

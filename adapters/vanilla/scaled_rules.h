// SPDX-License-Identifier: Apache-2.0
/// @file Scales the paper's constants with the image size and the number of visits per view, for runs that differ from
/// the paper's. Shared by the adapters of Gaussians and of convexes. None of these rules is in the paper.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "splatboost/hooks.h"
#include "splatboost/schedule.h"

namespace splatboost {

/// The paper's images have about a megapixel. Importance counts pixels: for smaller images the required count shrinks
/// with the image area, but not below one pixel per view. The mean over views is not rounded down to an integer.
inline constexpr double kTauDPixels = 1e6;

/// The threshold that Σ_j n_ij must exceed.
/// @param wanted flagged pixels per view that growth requires in images of the paper's size
/// @param pixels number of pixels per view
/// @param views K, number of scored views
inline double importance_to_exceed(double wanted, double pixels, int views) {
  const double least = std::max(1.0, wanted * std::min(1.0, pixels / kTauDPixels));
  return std::ceil(least * std::max(1, views)) - 1;
}

/// Iterations per training view after which opacities have settled; the paper's runs have at least twice this number.
inline constexpr double kSettledVisits = 50;

/// How often a run uses each of its training views.
inline double visits_per_view(Moment moment, std::size_t views) {
  return static_cast<double>(moment.total) / static_cast<double>(std::max<std::size_t>(views, 1));
}

/// Factor on a learning rate: `few` up to kSettledVisits visits per view, inversely proportional to the visits beyond,
/// down to `often`.
inline double rate_by_visits(double few, double often, double visits) {
  return few > often ? std::clamp(few * kSettledVisits / std::max(visits, kSettledVisits), often, few) : often;
}

/// Optimizer schedule of the paper's supplement, Sec. 9.1, not scaled: of kHigherBands, and of all other groups.
inline constexpr StepIntervals kRestIntervals{16, 32, 64};
inline constexpr StepIntervals kOtherIntervals{1, 32, 64};

/// Factor on their learning rate: rate_by_visits(), or `often` where the number of
/// training views is not known (0).
inline double higher_bands_rate(double few, double often, Moment moment, int training_views) {
  return training_views == 0
             ? often
             : rate_by_visits(few, often, visits_per_view(moment, static_cast<std::size_t>(training_views)));
}

/// Factor on the rate of means. 3DGS sets it × the scene extent, the spread of the cameras. In scenes photographed from
/// all around, which it was chosen for, that is about the distance to the scene; the errors of positions depend on the
/// distance. Photos from one side may have a distance of several times the extent.
/// @param depth_ratio typical depth of the scene in its views / extent; 0: not known
inline double rate_of_depth(double depth_ratio) {
  constexpr double kAllAround = 1.25;  ///< the ratio up to which nothing changes; most captures have less
  return std::max(1.0, depth_ratio / kAllAround);
}

/// 1, or less if views are visited fewer than kSettledVisits times: the square of the ratio, because primitives have
/// proportionally fewer visits to settle in before late pruning, and the others fewer to make up for the removed ones
/// after it. The opacity threshold of late pruning is multiplied by it, and so is the share of blending weights removed
/// when growth has ended.
/// @param views number of the backbone's training views
inline double settled_share(Moment moment, std::size_t views) {
  const double ratio = std::min(1.0, visits_per_view(moment, views) / kSettledVisits);
  return ratio * ratio;
}

/// Views rendered to measure the blending weights. Once per run, this many take less than 1% of the time.
inline constexpr int kWeighedViews = 50;

}  // namespace splatboost

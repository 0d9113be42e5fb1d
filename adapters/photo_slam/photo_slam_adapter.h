// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for Photo-SLAM, whose views come in while it trains: vanilla's rules on a set of views that favours the
/// newest, with scores of the views that see a primitive.
#pragma once

#include <concepts>
#include <type_traits>

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Vanilla's settings, some with other values, and, beyond them:
struct PhotoSlamBoost : VanillaBoost {
  PhotoSlamBoost();
  /// Share of the K views that are the newest: what they show was hardly trained on, and few of the others see it.
  double recent_share = 0.5;
};

/// Calls visit(name, field) for every setting.
template <class Boost, class Visitor>
requires std::same_as<std::remove_const_t<Boost>, PhotoSlamBoost>
void for_each_field(Boost& boost, Visitor&& visit) {
  using Vanilla = std::conditional_t<std::is_const_v<Boost>, const VanillaBoost, VanillaBoost>;
  for_each_field(static_cast<Vanilla&>(boost), visit);
  visit("recent_share", boost.recent_share);
}

/// Throws ArgumentError that names the setting unless all values are possible.
void check(const PhotoSlamBoost& boost);

/// The paper's text and numbers (supplement, Sec. 9.2).
PhotoSlamBoost literal_photo_slam_boost();

/// Nothing is kept from one event to the next, so that a closed loop leaves no score behind. Phases are shares of the
/// planned run (Moment::total), which a backbone extends while views come: late rules wait until they are all there.
/// The literal rules draw the K views evenly and divide by K, as the paper has it.
class PhotoSlamAdapter final : public VanillaAdapter {
 public:
  PhotoSlamAdapter(const PhotoSlamBoost& boost, Device device);

 protected:
  const ScoreSums& score(RasterizerHook& rasterizer, bool losses, const RandomStream& random) override;

 private:
  double recent_share_;
  Device device_;
  ScoreSums sums_;
};

}  // namespace splatboost

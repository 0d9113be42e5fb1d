// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for Photo-SLAM, whose views come in while it trains: vanilla's rules on a set of views that favours the
/// newest, with scores of the views that see a primitive.
#pragma once

#include <concepts>
#include <optional>
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

/// No score is kept from one event to the next, so that a closed loop leaves no score behind. Phases are shares of the
/// planned run (Moment::total), which a backbone extends while views come: late rules wait until they are all there.
/// A plan may change afterwards too, where a run ends by the clock. So late pruning is counted: each one that is due by
/// the moment's share of the plan comes once, late if the plan passed over it, and after the first nothing grows.
/// The literal rules draw the K views evenly and divide by K, as the paper has it, at the paper's moments.
class PhotoSlamAdapter final : public VanillaAdapter {
 public:
  PhotoSlamAdapter(const PhotoSlamBoost& boost, Device device);

  bool grows_at(Moment moment, bool backbone_would) const override;
  void prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) override;

 protected:
  bool growth_ended_at(Moment moment) const override;
  bool prunes_late_at(Moment moment) const override;
  const ScoreSums& score(RasterizerHook& rasterizer, bool losses, const RandomStream& random) override;

 private:
  /// What of late pruning is due by a moment.
  struct LatePruning {
    bool growth_ended = false;
    int prunes = 0;  ///< that of the end of growth among them
  };
  LatePruning due_by(Moment moment) const;
  /// What has been done, as far as `moment` knows: a run that is continued has done what was due before.
  const LatePruning& done(Moment moment) const;

  mutable std::optional<LatePruning> done_;  ///< none: not asked yet
  double recent_share_;
  Device device_;
  ScoreSums sums_;
};

}  // namespace splatboost

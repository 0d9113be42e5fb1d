// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for Photo-SLAM, whose views arrive during training: vanilla's rules on a selection of views that
/// favours the newest, with scores averaged over the views that see a primitive.
#pragma once

#include <concepts>
#include <limits>
#include <optional>
#include <type_traits>

#include "vanilla/vanilla_adapter.h"

namespace splatboost {

/// Vanilla's settings, some with other defaults, and recent_share.
struct PhotoSlamBoost : VanillaBoost {
  PhotoSlamBoost();
  /// Share of the K views that are the newest: their content has had little training, and few older views see it.
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

/// Throws ArgumentError, naming the setting, if a value is out of range.
void check(const PhotoSlamBoost& boost);

/// The paper's rules and numbers (supplement, Sec. 9.2).
PhotoSlamBoost literal_photo_slam_boost();

/// Scores are recomputed at every event, so that none is stale after a loop closure. Phases are fractions of the
/// planned run (Moment::total). The backbone extends the plan while views arrive, so late pruning waits until all are
/// there; in a run limited by time the plan may change later too. Late prunings are therefore counted: each one due at
/// the current fraction of the plan happens once, delayed if a change of plan skipped its iteration. Nothing grows
/// after the pruning at the end of growth. The literal rules draw the K views uniformly and divide by K, at the paper's
/// iterations.
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
  /// The late pruning due by a moment.
  struct LatePruning {
    bool growth_ended = false;
    int prunes = 0;  ///< number of late prunings, including the one at the end of growth
  };
  LatePruning due_by(Moment moment) const;
  /// The late pruning done so far. Before the first of this object, everything due before the earliest moment asked
  /// about counts as done (a resumed run).
  const LatePruning& done(Moment moment) const;

  mutable std::optional<LatePruning> done_;              ///< nullopt before the first call of done()
  mutable int begun_ = std::numeric_limits<int>::max();  ///< earliest iteration asked about
  bool pruned_ = false;                                  ///< done_ was set by prune()
  double recent_share_;
  Device device_;
  ScoreSums sums_;
};

}  // namespace splatboost

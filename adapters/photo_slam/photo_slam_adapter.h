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

/// Vanilla's settings, some with other defaults, and those of views that arrive.
struct PhotoSlamBoost : VanillaBoost {
  PhotoSlamBoost();
  /// Share of the K views that are the newest: their content has had little training, and few older views see it.
  double recent_share = 0.5;
  /// Growth goes on for this many iterations, scaled like densify_until, after the last view has arrived, but at most
  /// for a quarter of what is left of the run.
  int densify_after_view = 3000;
};

/// Calls visit(name, field) for every setting.
template <class Boost, class Visitor>
requires std::same_as<std::remove_const_t<Boost>, PhotoSlamBoost>
void for_each_field(Boost& boost, Visitor&& visit) {
  using Vanilla = std::conditional_t<std::is_const_v<Boost>, const VanillaBoost, VanillaBoost>;
  for_each_field(static_cast<Vanilla&>(boost), visit);
  visit("recent_share", boost.recent_share);
  visit("densify_after_view", boost.densify_after_view);
}

/// Throws ArgumentError, naming the setting, if a value is out of range.
void check(const PhotoSlamBoost& boost);

/// The paper's rules and numbers (supplement, Sec. 9.2).
PhotoSlamBoost literal_photo_slam_boost();

/// Scores are recomputed at every event, so that none is stale after a loop closure. Phases are fractions of the
/// planned run (Moment::total), but growth ends only some time after the last view has arrived, and starts again if
/// one arrives later, which is noticed at the next pruning. The plan changes while views arrive, and in a run limited
/// by time later too. Late prunings are therefore counted: each one due at the current fraction of the plan happens
/// once, delayed if a change of plan skipped its iteration. Nothing grows between the pruning at the end of growth and
/// the next view. The literal rules draw the K views uniformly and divide by K, at the paper's iterations.
class PhotoSlamAdapter final : public VanillaAdapter {
 public:
  PhotoSlamAdapter(const PhotoSlamBoost& boost, Device device);

  bool grows_at(Moment moment, bool backbone_would) const override;
  void grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) override;
  void prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) override;

 protected:
  bool growth_ended_at(Moment moment) const override;
  bool prunes_late_at(Moment moment) const override;
  int growth_end(Moment moment) const override;
  const ScoreSums& score(RasterizerHook& rasterizer, bool losses, const RandomStream& random) override;

 private:
  /// The late pruning due by a moment.
  struct LatePruning {
    bool growth_ended = false;
    int prunes = 0;  ///< number of late prunings, including the one at the end of growth
  };
  LatePruning due_by(Moment moment) const;
  /// Notes whether views have arrived since the last event. Those at the first event of this object do not count.
  void note_views(Moment moment, std::size_t views);
  /// The late pruning done so far. Before the first of this object, everything due before the earliest moment asked
  /// about counts as done (a resumed run).
  const LatePruning& done(Moment moment) const;

  mutable std::optional<LatePruning> done_;              ///< nullopt before the first call of done()
  mutable int begun_ = std::numeric_limits<int>::max();  ///< earliest iteration asked about
  bool pruned_ = false;                                  ///< done_ was set by prune()
  double recent_share_;
  int densify_after_view_;
  std::size_t views_ = 0;               ///< at the last event
  std::optional<int> view_arrived_at_;  ///< the first event with the newest view; nullopt: none has arrived
  Device device_;
  ScoreSums sums_;
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "photo_slam/photo_slam_adapter.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "photo_slam/recent_views.h"
#include "registry/boost_settings.h"

namespace splatboost {

PhotoSlamBoost::PhotoSlamBoost() {
  // Photo-SLAM's threshold is five times 3DGS's, because most of its Gaussians come from features. These are a tenth
  // lower: with more pruned by late_share, there are fewer Gaussians at the same quality (docs/results/backbones.md).
  gradient_threshold = 9e-4;
  gradient_abs_threshold = 2.7e-3;
  // For the same reason many Gaussians are faint: others have replaced those inserted from features. 0.1 was
  // measured too (docs/results/backbones.md).
  late_min_opacity = 0.2;
  // The few keyframes need most Gaussians of small weight: vanilla's 5 % cost 0.5 dB on red kitchen, two seeds.
  late_share = 0.025;
  replaced_share = 0;  // not measured here: the map still grows when a cap is reached
  // The number of keyframes is not known when the run begins. Red kitchen has 0.2 dB less with 2, 0.3 to 0.4 dB less
  // with 1; the walk hardly changes.
  rest_rate = rest_rate_few = 4;
  // The scene extent is that of the first keyframes, which lie close together: with vanilla's 0.001 nothing would be
  // small enough to clone.
  percent_dense = 0.01;
  // Longer than vanilla, whose views are all there from the start.
  densify_until = late_prune_from = 10000;
  average_share = 0;      // measured: no gain; and the end of a run is not known
  rate_by_depth = false;  // its rates do not depend on the extent, and the scene is not known at the start
  min_clearance = 0;      // the camera may return to where it was, and the scene is not known at the start
  prune_large = true;     // as the settings of a patched host say; in-tree there is no such rule
  // Photo-SLAM starts every keyframe with small images anyway.
  coarse = false;
  // The mapper has its own way to add points, as keyframes arrive.
  fill_gaps = false;
}

void check(const PhotoSlamBoost& boost) {
  check(static_cast<const VanillaBoost&>(boost));
  check_setting(boost.recent_share >= 0 && boost.recent_share <= 1, "recent_share must be in [0, 1]");
  check_setting(boost.densify_after_view >= 0, "densify_after_view must be at least 0");
}

PhotoSlamBoost literal_photo_slam_boost() {
  PhotoSlamBoost boost;
  static_cast<VanillaBoost&>(boost) = literal_boost();
  boost.recent_share = 0;
  boost.schedule = false;  // plain Adam
  return boost;
}

PhotoSlamAdapter::PhotoSlamAdapter(const PhotoSlamBoost& boost, Device device)
    : VanillaAdapter(boost, device),
      recent_share_(boost.recent_share),
      densify_after_view_(boost.densify_after_view),
      device_(device) {
  check(boost);
}

const ScoreSums& PhotoSlamAdapter::score(RasterizerHook& rasterizer, bool losses, const RandomStream& random) {
  if (is_literal()) return VanillaAdapter::score(rasterizer, losses, random);
  ChosenViews chosen(rasterizer, recent_and_drawn_views(rasterizer.scorable_views(), views(), recent_share_, random),
                     device_);
  sums_ = VanillaAdapter::score(chosen, losses, random);
  // Scales each primitive's sums as if all scored views saw it.
  for (std::size_t i = 0; i < sums_.counts.size(); ++i) {
    const double factor = static_cast<double>(sums_.views) / std::max(1, chosen.seen()[i]);
    sums_.counts[i] = std::llround(static_cast<double>(sums_.counts[i]) * factor);
  }
  for (std::size_t i = 0; i < sums_.weighted_counts.size(); ++i) {
    sums_.weighted_counts[i] *= static_cast<double>(sums_.views) / std::max(1, chosen.seen()[i]);
  }
  return sums_;
}

int PhotoSlamAdapter::growth_end(Moment moment) const {
  const int end = VanillaAdapter::growth_end(moment);
  if (is_literal() || !view_arrived_at_) return end;
  // If most of the run is over, most of the rest is for optimization without growth.
  const int left = std::max(0, moment.total - *view_arrived_at_);
  return std::max(end, *view_arrived_at_ + std::min(at(densify_after_view_, moment), left / 4));
}

void PhotoSlamAdapter::note_views(Moment moment, std::size_t views) {
  const bool arrived = views_ != 0 && views > views_;
  views_ = views;
  if (!arrived) return;
  view_arrived_at_ = moment.iteration;
  if (done_) *done_ = {};
}

PhotoSlamAdapter::LatePruning PhotoSlamAdapter::due_by(Moment moment) const {
  const int end = std::max(at(boost().late_prune_from, moment), growth_end(moment));
  const int last = std::min(moment.iteration, moment.total - 1), interval = boost().late_prune_interval;
  LatePruning due;
  due.growth_ended = last >= end;
  if (!due.growth_ended) return due;
  due.prunes = 1;
  for (std::int64_t next = interval; next < boost().published_iterations; next += interval) {
    const int due_at = at(static_cast<int>(next), moment);
    if (due_at > end && due_at <= last) ++due.prunes;
  }
  return due;
}

const PhotoSlamAdapter::LatePruning& PhotoSlamAdapter::done(Moment moment) const {
  if (!pruned_ && moment.iteration < begun_) {
    begun_ = moment.iteration;
    done_ = due_by({begun_ - 1, moment.total});
  }
  return *done_;
}

bool PhotoSlamAdapter::growth_ended_at(Moment moment) const {
  if (is_literal()) return VanillaAdapter::growth_ended_at(moment);
  return due_by(moment).growth_ended && !done(moment).growth_ended;
}

bool PhotoSlamAdapter::prunes_late_at(Moment moment) const {
  if (is_literal()) return VanillaAdapter::prunes_late_at(moment);
  if (!boost().vcp || moment.iteration >= moment.total) return false;
  return due_by(moment).prunes > done(moment).prunes;
}

bool PhotoSlamAdapter::grows_at(Moment moment, bool backbone_would) const {
  return VanillaAdapter::grows_at(moment, backbone_would) && !(boost().vcp && done(moment).growth_ended);
}

void PhotoSlamAdapter::grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) {
  note_views(statistics.moment, rasterizer.scorable_views());
  VanillaAdapter::grow(statistics, rasterizer, decisions);
}

void PhotoSlamAdapter::prune(const DensityStatistics& statistics, RasterizerHook& rasterizer,
                             PruneDecisions& decisions) {
  note_views(statistics.moment, rasterizer.scorable_views());
  VanillaAdapter::prune(statistics, rasterizer, decisions);
  if (is_literal() || decisions.rule != PruneRule::late || !prunes_late_at(statistics.moment)) return;
  const LatePruning due = due_by(statistics.moment);
  done_ = {done_->growth_ended || due.growth_ended, std::max(done_->prunes, due.prunes)};
  pruned_ = true;
}

AdapterEntry photo_slam_adapter_entry() {
  return {"photo-slam", [](bool literal) {
            return make_settings<PhotoSlamAdapter>(literal ? literal_photo_slam_boost() : PhotoSlamBoost{});
          }};
}

}  // namespace splatboost

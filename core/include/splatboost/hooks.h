// SPDX-License-Identifier: Apache-2.0
/// @file The three places where acceleration meets a backbone. Read this page and you know how SplatBoost plugs in.
///
/// A *primitive* is whatever the backbone grows and removes: a Gaussian, an (anchor, offset) slot, a convex. The
/// backbone numbers its primitives 0 .. N-1 and keeps that numbering between two of its own changes.
///
///   RasterizerHook   the backbone implements it:  "draw view j", "who was blended where these pixels are flagged?"
///   DensityHook      an adapter implements it:    "these would grow (go) by your own rule; which shall?"
///   OptimizerHook    an adapter implements it:    "does this parameter group step now, how far?"
///
/// A backbone without hooks is exactly its published self.
///
/// Pictures, masks and counts of the RasterizerHook lie in the memory of the backbone's device, which a MultiViewScorer
/// of that device works on. Statistics and decisions of the DensityHook are always in memory of the host.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "splatboost/errors.h"
#include "splatboost/photometric.h"
#include "splatboost/schedule.h"

namespace splatboost {

/// A view as the scores need it, in memory of the device; valid until the next render_for_score() or change of the
/// backbone.
struct ScoredView {
  std::span<const float> color;  ///< [3,H,W] rendered, without anything random (dropout, exposure jitter)
  TruthImage truth;
};

/// Operations of a backbone's renderer that adapters may call.
class RasterizerHook {
 public:
  virtual ~RasterizerHook() = default;
  /// Compact box with this β from now on; nullopt restores the backbone's own box.
  virtual void set_beta(std::optional<float> beta) = 0;
  virtual std::size_t primitives() const = 0;
  /// Training views that may be scored now, numbered 0 .. n-1 (a SLAM backbone's grows).
  virtual std::size_t scorable_views() const = 0;
  virtual ScoredView render_for_score(std::size_t view) = 0;
  /// Adds to counts [N] the flagged pixels where each primitive was blended in the view just rendered, by replaying
  /// its tile lists. A backbone whose Gaussians differ from view to view maps them to its primitives here.
  virtual void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) = 0;
  /// Adds to weights [N] the blending weights of each primitive in the view just rendered, as
  /// Rasterizer::add_weights(). Only backbones of Gaussians and of convexes, whose adapters ask for them, have them.
  virtual void add_weights(std::span<std::int32_t> weights) {
    (void)weights;
    throw ArgumentError("this backbone tells no blending weights");
  }
};

/// What a backbone knows about its primitives when it would grow or prune. Spans are [N] unless said otherwise, read
/// only, valid during the call; empty where the backbone has no such notion.
struct DensityStatistics {
  Moment moment;
  float scene_extent = 0;                ///< radius of the camera positions, world units
  std::span<const float> gradients;      ///< mean norm of the signed screen gradient, in NDC units
  std::span<const float> gradients_abs;  ///< same of the absolute gradient (AbsGS)
  std::span<const float> opacities;      ///< activated
  std::span<const float> max_scales;     ///< longest standard deviation, world units
};

/// Decisions about growth. They arrive holding what the backbone's own rule says; the hook overwrites them.
struct GrowDecisions {
  std::span<std::uint8_t> clone;  ///< [N] duplicate (for an anchor backbone: grow from this slot)
  std::span<std::uint8_t> split;  ///< [N] replace by smaller ones; empty where the backbone cannot
  /// [N] which of them grow where a cap does not let all, largest first (growth_priority() of what accepts each); empty
  /// where the backbone ranks otherwise
  std::span<float> priorities = {};
};

/// Whose candidates for removal these are.
enum class PruneRule {
  growth,  ///< the backbone's own, of the pruning that belongs to the growth just made
  trim,    ///< the backbone's own for another reason (seen by too few views); a hook lets them go unless it protects
  late,    ///< none: prunes_at() asked
};

/// Decisions about removal. They arrive holding the backbone's candidates.
struct PruneDecisions {
  std::span<std::uint8_t> remove;  ///< [N]
  PruneRule rule = PruneRule::late;
  /// [N] index that the primitive (or the one it was made from) had in that growth's grow(); empty otherwise
  std::span<const std::uint32_t> origins;
};

/// Decides what exists. The backbone mutates itself, and may veto (a SLAM backbone spares what it just inserted).
class DensityHook {
 public:
  virtual ~DensityHook() = default;
  /// Whether the backbone shall gather gradients_abs; without it that span may be empty.
  virtual bool needs_absolute_gradients() const { return false; }
  virtual bool grows_at(Moment moment, bool backbone_would) const {
    (void)moment;
    return backbone_would;
  }
  virtual void grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) = 0;
  virtual bool prunes_at(Moment moment, bool backbone_would) const {
    (void)moment;
    return backbone_would;
  }
  virtual void prune(const DensityStatistics& statistics, RasterizerHook& rasterizer, PruneDecisions& decisions) = 0;
  /// Whether the backbone now lowers all opacities (3DGS's reset). Asked at every iteration, after growth and pruning;
  /// a backbone that has no resets never asks.
  virtual bool resets_opacities_at(Moment moment, bool backbone_would) const {
    (void)moment;
    return backbone_would;
  }
};

/// Decides when parameters move, and how far. Between steps gradients accumulate; the backbone applies what is
/// accumulated before it removes primitives and at the end of the run.
class OptimizerHook {
 public:
  virtual ~OptimizerHook() = default;
  /// @param group the backbone's own name of the group
  virtual bool steps_at(std::string_view group, Moment moment) const = 0;
  /// What the backbone's own learning rate of the group is multiplied by.
  virtual float rate_factor(std::string_view group, Moment moment) const {
    (void)group, (void)moment;
    return 1;
  }
};

}  // namespace splatboost

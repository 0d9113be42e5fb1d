// SPDX-License-Identifier: Apache-2.0
/// @file The three interfaces between the acceleration methods and a backbone.
///
/// A *primitive* is what the backbone grows and removes: a Gaussian, an (anchor, offset) slot, a convex. The backbone
/// numbers its primitives 0 .. N-1 and keeps the numbering until its own next change (growth, pruning, reordering).
///
///   RasterizerHook   implemented by the backbone:  renders views, counts flagged pixels per primitive
///   DensityHook      implemented by an adapter:    decides which primitives are cloned, split or removed
///   OptimizerHook    implemented by an adapter:    decides whether a parameter group steps now, and how far
///
/// A backbone without hooks behaves exactly as published.
///
/// Images, masks and counts of the RasterizerHook are in the memory of the backbone's device; a MultiViewScorer must be
/// of the same device. Statistics and decisions of the DensityHook are always in host memory.
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

/// A rendered view to be scored, in device memory; valid until the next render_for_score() or change of the
/// backbone.
struct ScoredView {
  std::span<const float> color;  ///< [3,H,W] rendered, without randomness (dropout, exposure jitter)
  TruthImage truth;
};

/// Operations of a backbone's renderer that adapters may call.
class RasterizerHook {
 public:
  virtual ~RasterizerHook() = default;
  /// Uses the compact box with this β from now on; nullopt restores the backbone's own box.
  virtual void set_beta(std::optional<float> beta) = 0;
  virtual std::size_t primitives() const = 0;
  /// Training views that may be scored now, numbered 0 .. n-1 (n grows in a SLAM backbone).
  virtual std::size_t scorable_views() const = 0;
  /// Renders a training view with all its splats: on a GPU after Rasterizer::settle(), because a frame that had too
  /// little room lacks some.
  virtual ScoredView render_for_score(std::size_t view) = 0;
  /// Adds to counts [N] the number of flagged pixels where each primitive was blended in the view just rendered, by
  /// replaying its tile lists. A backbone whose Gaussians differ per view maps them to its primitives here.
  /// @param flagged [H,W] of that view, non-zero where flagged
  virtual void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) = 0;
  /// Adds to weights [N] the blending weights of each primitive in the view just rendered, as
  /// Rasterizer::add_weights(). Throws unless overridden, which DensityHook::needs_weights() requires.
  virtual void add_weights(std::span<std::int32_t> weights) {
    (void)weights;
    throw ArgumentError("this backbone provides no blending weights");
  }
};

/// What a backbone knows about its primitives when it grows or prunes. Spans are [N] unless stated otherwise, read-only
/// and valid during the call; empty if the backbone has no such quantity.
struct DensityStatistics {
  Moment moment;
  float scene_extent = 0;  ///< 1.1 · largest distance of a training camera from their mean (3DGS), world units
  std::span<const float> gradients;        ///< mean norm of the signed screen gradient, in NDC units
  std::span<const float> gradients_abs;    ///< the same for the absolute gradient (AbsGS)
  std::span<const float> opacities;        ///< activated
  std::span<const float> max_scales;       ///< longest standard deviation, world units
  std::span<const float> clearances = {};  ///< from the training cameras (clearance.h); for pruning
  std::size_t max_primitives = 0;          ///< cap that the backbone enforces; 0: none, or not reported
};

/// Decisions about growth. On entry they hold the decisions of the backbone's own rule; the hook overwrites them.
struct GrowDecisions {
  std::span<std::uint8_t> clone;  ///< [N] non-zero: duplicate (for an anchor backbone: grow from this slot)
  /// [N] non-zero: replace by smaller primitives. Empty if the backbone cannot split; only the adapters of anchors
  /// accept that
  std::span<std::uint8_t> split;
  /// [N] if a cap on the number of primitives does not admit all, those of the largest priority grow: growth_priority()
  /// of the gradient and threshold that accept each. Empty if the backbone ranks them in another way
  std::span<float> priorities = {};
};

/// The rule that selected the candidates for removal.
enum class PruneRule {
  growth,  ///< the backbone's own pruning directly after growth
  trim,    ///< the backbone's own for another reason (seen by too few views); a hook normally leaves them selected
  late,    ///< no candidates: the call is due to prunes_at()
};

/// Decisions about removal. On entry they hold the backbone's candidates.
struct PruneDecisions {
  std::span<std::uint8_t> remove;  ///< [N] non-zero: remove
  PruneRule rule = PruneRule::late;
  /// PruneRule::growth: [N] index of the primitive (or of the one it was made from) in the preceding grow(); else empty
  std::span<const std::uint32_t> origins;
};

/// Decides which primitives exist. The backbone applies the decisions and may veto them (a SLAM backbone keeps the
/// primitives that it has just inserted). grow() and prune() throw ArgumentError, naming them, if statistics that they
/// need are missing: growth by absolute gradients needs gradients, gradients_abs and max_scales, late pruning needs
/// opacities.
class DensityHook {
 public:
  virtual ~DensityHook() = default;
  /// Whether the backbone must accumulate gradients_abs; otherwise that span may be empty.
  virtual bool needs_absolute_gradients() const { return false; }
  /// Whether prune() uses clearances; otherwise that span may be empty.
  virtual bool needs_clearances() const { return false; }
  /// Whether grow() or prune() may call RasterizerHook::add_weights().
  virtual bool needs_weights() const { return false; }
  /// Like prunes_at() and resets_opacities_at(), may also be asked in advance, about later iterations.
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
  /// Whether the backbone's candidates in growth include primitives that are large in the world (3DGS). Called at each
  /// growth; never called by a backbone without that rule.
  virtual bool prunes_large_at(Moment moment, bool backbone_would) const {
    (void)moment;
    return backbone_would;
  }
  /// Whether the backbone now lowers all opacities (3DGS's reset). Called at every iteration, after growth and pruning;
  /// never called by a backbone without resets.
  virtual bool resets_opacities_at(Moment moment, bool backbone_would) const {
    (void)moment;
    return backbone_would;
  }
};

/// Name of the group of the coefficients of higher SH bands, for which adapters of Gaussians and of convexes have rules
/// of their own. Other names are the backbone's; the adapters of anchors and of Deformable-3DGS know some of
/// theirs.
inline constexpr std::string_view kHigherBands = "f_rest";
/// Parameter group of the means of Gaussians.
inline constexpr std::string_view kMeans = "xyz";

/// Decides when parameters are updated, and by how much. Gradients accumulate between steps; the backbone applies the
/// accumulated gradients before it removes primitives and at the end of the run.
class OptimizerHook {
 public:
  virtual ~OptimizerHook() = default;
  /// Depends on the arguments only: it is also asked in advance, about later iterations.
  /// @param group the backbone's name of the group; kHigherBands for that one
  virtual bool steps_at(std::string_view group, Moment moment) const = 0;
  /// Whether the backbone now adds the values of all groups to their averages, which replace the values at the end of
  /// the run. Asked after the steps of each iteration; a backbone without averages does not ask. If it is true at the
  /// last iteration, steps_at() must be true for every group there.
  virtual bool averages_at(Moment moment) const {
    (void)moment;
    return false;
  }
  /// Factor on the backbone's own learning rate of the group.
  virtual float rate_factor(std::string_view group, Moment moment) const {
    (void)group, (void)moment;
    return 1;
  }
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file FastGS for anchor-based backbones, whose primitives are (anchor, offset) slots: VCD gates the slots that would
/// grow, CB is the compact box, and learning rates fall late in the run. VCP does not apply: the anchor of a pruned
/// Gaussian would generate it again.
#pragma once

#include <concepts>
#include <cstdint>
#include <optional>
#include <string_view>
#include <type_traits>
#include <vector>

#include "registry/adapter.h"
#include "splatboost/device.h"
#include "splatboost/hooks.h"
#include "splatboost/multi_view_scores.h"

namespace splatboost {

/// The parts and constants of the method.
struct ScaffoldBoost {
  bool vcd = true;  ///< multi-view consistent densification
  bool cb = true;   ///< compact box
  /// Decays the learning rates that the published runs hold constant, from rates_fall_from on. Ours, not the paper's.
  bool schedule = true;
  double rates_fall_from = 0.5;  ///< share of the run; published growth ends there
  /// Larger than the paper's 0.5; found on one scene (docs/results/backbones.md).
  float beta = 0.7f;
  /// Rate a slot by the paper's importance, ⌊Σ n / K⌋ flagged pixels (eq. 9), instead of by its density of errors.
  bool literal = false;
  double tau_d = 5;  ///< importance that growth must exceed
  int views = 10;    ///< K
  float tau = 0.1f;  ///< error threshold
  /// An in-tree trainer starts with half-size views. Not in the paper.
  bool coarse = true;
  double coarse_until = 0.3;  ///< until this share of the run
  /// An in-tree trainer adds points of features that several photos share. Not in the paper.
  bool track_points = true;
  /// An in-tree trainer scales the lengths of the backbone's settings to the scene. Not in the paper.
  bool scale_lengths = true;

  std::uint64_t seed = 0;  ///< of the run; not a user setting
};

/// Calls visit(name, field) for every setting.
template <class Boost, class Visitor>
requires std::same_as<std::remove_const_t<Boost>, ScaffoldBoost>
void for_each_field(Boost& boost, Visitor&& visit) {
  visit("vcd", boost.vcd);
  visit("cb", boost.cb);
  visit("schedule", boost.schedule);
  visit("rates_fall_from", boost.rates_fall_from);
  visit("literal", boost.literal);
  visit("beta", boost.beta);
  visit("tau_d", boost.tau_d);
  visit("views", boost.views);
  visit("tau", boost.tau);
  visit("coarse", boost.coarse);
  visit("coarse_until", boost.coarse_until);
  visit("track_points", boost.track_points);
  visit("scale_lengths", boost.scale_lengths);
}

/// Throws ArgumentError, naming the setting, if a value is out of range.
void check(const ScaffoldBoost& boost);

/// The paper's rules and numbers (supplement, Secs. 9.2 and 9.3).
ScaffoldBoost literal_scaffold_boost();

/// Importance of a slot with exactly the number of flagged pixels that evenly distributed errors would give it. With it
/// the paper's τ_d = 5 requires 1.25 times that number. Ours, not the paper's, found on runs of 5 000 iterations.
inline constexpr double kImportanceOfEvenErrors = 4;

/// Factor on the learning rates of anchor features, scalings and the covariance MLP at the end of the run. With
/// constant rates a short run does not settle (docs/results/backbones.md).
inline constexpr double kFinalRateFactor = 0.1;

class ScaffoldAdapter final : public Adapter {
 public:
  /// @param device the backbone's device, on which views are scored
  ScaffoldAdapter(const ScaffoldBoost& boost, Device device);

  std::optional<float> beta() const override;

  /// Keeps the backbone's candidate slots whose errors are denser than elsewhere in the same views: their importance,
  /// kImportanceOfEvenErrors · Σ n / Σ (share of the view · valid pixels of the slot), exceeds τ_d. The sums run over
  /// the K views, n is the slot's number of flagged pixels, and the share of a view is the fraction of flagged pixels
  /// among the valid pixels of all slots. A slot also needs at least K flagged pixels. The paper's count of pixels
  /// would favour large slots and slots drawn in many views; and the fraction of a view that is flagged depends on its
  /// worst pixel.
  void grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) override;
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions&) override {}

  /// True: every group steps at every iteration, as published.
  bool steps_at(std::string_view, Moment) const override { return true; }
  /// For the groups whose published rates are constant: falls log-linearly from 1 at rates_fall_from to
  /// kFinalRateFactor. 1 for all others.
  float rate_factor(std::string_view group, Moment moment) const override;

 private:
  ScaffoldBoost boost_;
  Device device_;
  MultiViewScorer scorer_;
  std::vector<std::int64_t> importance_;
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "scaffold_gs/scaffold_adapter.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "registry/boost_settings.h"
#include "splatboost/array.h"
#include "splatboost/errors.h"
#include "splatboost/select.h"

namespace splatboost {
namespace {

double sum_of(std::span<const std::int32_t> values) {
  return static_cast<double>(std::accumulate(values.begin(), values.end(), std::int64_t{0}));
}

/// Forwards to a rasterizer, and replays each scored view once more with every valid pixel flagged. Computes how many
/// flagged pixels each slot would have if the errors of a view were spread evenly over the valid pixels of all slots.
class EvenErrors final : public RasterizerHook {
 public:
  EvenErrors(RasterizerHook& inner, Device device)
      : inner_(inner), device_(device), counts_(inner.primitives(), 0), all_(device), drawn_(device) {}
  void set_beta(std::optional<float> beta) override { inner_.set_beta(beta); }
  std::size_t primitives() const override { return inner_.primitives(); }
  std::size_t scorable_views() const override { return inner_.scorable_views(); }
  ScoredView render_for_score(std::size_t view) override {
    const ScoredView scored = inner_.render_for_score(view);
    valid_ = scored.truth.valid;
    return scored;
  }
  /// @param counts of this view alone; must be zero on entry
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    inner_.count_flagged(flagged, counts);
    if (valid_.empty() && all_.size() != flagged.size()) all_.assign(std::vector<std::uint8_t>(flagged.size(), 1));
    drawn_.assign_zeros(counts.size());
    inner_.count_flagged(valid_.empty() ? std::as_const(all_).span() : valid_, drawn_);
    const std::span<const std::int32_t> drawn = drawn_.on_host(copy_);
    const double share = sum_of(copy_to_host<std::int32_t>(counts, device_)) / std::max(1.0, sum_of(drawn));
    for (std::size_t i = 0; i < counts_.size(); ++i) counts_[i] += share * drawn[i];
  }
  /// [N] flagged pixels with evenly spread errors, summed over the views so far
  std::span<const double> counts() const { return counts_; }

 private:
  RasterizerHook& inner_;
  Device device_;
  std::vector<double> counts_;
  std::span<const std::uint8_t> valid_;  ///< mask of the view just rendered; empty: all pixels
  Array<std::uint8_t> all_;
  Array<std::int32_t> drawn_;
  std::vector<std::int32_t> copy_;  ///< host copy of drawn_ if it is on a GPU
};

/// Keeps candidates with at least `least` flagged pixels and more than `factor` × `even`.
void keep_dense_errors(std::span<const std::int64_t> flagged, std::span<const double> even, double factor,
                       std::int64_t least, std::span<std::uint8_t> candidates) {
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const bool dense = static_cast<double>(flagged[i]) > factor * even[i];
    if (!dense || flagged[i] < least) candidates[i] = 0;
  }
}

}  // namespace

void check(const ScaffoldBoost& boost) {
  check_setting(boost.rates_fall_from >= 0 && boost.rates_fall_from < 1, "rates_fall_from must be in [0, 1)");
  check_setting(boost.beta > 0 && boost.beta <= 1, "beta must be in (0, 1]");
  check_setting(boost.tau_d >= 0 && std::isfinite(boost.tau_d), "tau_d must be at least 0");
  check_setting(boost.views >= 1, "views must be at least 1");
  check_setting(boost.tau > 0 && boost.tau < 1, "tau must be in (0, 1)");
  check_setting(boost.coarse_until >= 0 && boost.coarse_until <= 1, "coarse_until must be in [0, 1]");
}

ScaffoldBoost literal_scaffold_boost() {
  ScaffoldBoost boost;
  boost.literal = true;
  boost.schedule = false;
  boost.beta = 0.5f;
  boost.coarse = false;
  boost.track_points = false;
  boost.scale_lengths = false;
  return boost;
}

ScaffoldAdapter::ScaffoldAdapter(const ScaffoldBoost& boost, Device device)
    : boost_(boost), device_(device), scorer_(device) {
  check(boost);
}

std::optional<float> ScaffoldAdapter::beta() const {
  return boost_.cb ? std::optional<float>(boost_.beta) : std::nullopt;
}

float ScaffoldAdapter::rate_factor(std::string_view group, Moment moment) const {
  const bool constant = group == "anchor_feat" || group == "scaling" || group == "mlp_cov";
  if (!boost_.schedule || !constant) return 1;
  const double done = static_cast<double>(moment.iteration) / moment.total;
  const double late = (done - boost_.rates_fall_from) / (1 - boost_.rates_fall_from);  // 1 at the end
  return static_cast<float>(std::pow(kFinalRateFactor, std::clamp(late, 0.0, 1.0)));
}

void ScaffoldAdapter::grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) {
  // Without candidates there is nothing to gate: saves rendering the K views.
  const bool any =
      std::any_of(decisions.clone.begin(), decisions.clone.end(), [](std::uint8_t wants) { return wants != 0; });
  if (!boost_.vcd || !any) return;
  MultiViewOptions options;
  options.views = boost_.views;
  options.tau = boost_.tau;
  options.losses = false;  // anchors are not pruned by scores
  const RandomStream random(boost_.seed, static_cast<std::uint64_t>(statistics.moment.iteration),
                            RandomPurpose::scored_views);
  if (boost_.literal) {
    importance_.resize(rasterizer.primitives());
    importance_scores(scorer_.score(rasterizer, options, random), importance_);
    keep_important(importance_, boost_.tau_d, decisions.clone);
  } else {
    EvenErrors even(rasterizer, device_);
    const ScoreSums& found = scorer_.score(even, options, random);
    keep_dense_errors(found.counts, even.counts(), boost_.tau_d / kImportanceOfEvenErrors, found.views,
                      decisions.clone);
  }
}

AdapterEntry scaffold_gs_adapter_entry() {
  return {"scaffold-gs", [](bool literal) {
            return make_settings<ScaffoldAdapter>(literal ? literal_scaffold_boost() : ScaffoldBoost{});
          }};
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "scaffold_gs/scaffold_adapter.h"

#include <algorithm>
#include <numeric>

#include "splatboost/array.h"
#include "splatboost/errors.h"
#include "splatboost/select.h"

namespace splatboost {
namespace {

/// Passes everything on, and replays each scored view once more, with every pixel flagged, to count the pixels of each
/// slot.
class PixelsOfSlots final : public RasterizerHook {
 public:
  PixelsOfSlots(RasterizerHook& inner, Device device)
      : inner_(inner), sums_(inner.primitives(), 0), all_(device), drawn_(device) {}
  void set_beta(std::optional<float> beta) override { inner_.set_beta(beta); }
  std::size_t primitives() const override { return inner_.primitives(); }
  std::size_t scorable_views() const override { return inner_.scorable_views(); }
  ScoredView render_for_score(std::size_t view) override { return inner_.render_for_score(view); }
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    inner_.count_flagged(flagged, counts);
    if (all_.size() != flagged.size()) all_.assign(std::vector<std::uint8_t>(flagged.size(), 1));
    drawn_.assign_zeros(counts.size());
    inner_.count_flagged(all_, drawn_);
    const std::span<const std::int32_t> drawn = drawn_.on_host(copy_);
    for (std::size_t i = 0; i < sums_.size(); ++i) sums_[i] += drawn[i];
  }
  /// [N] over the views so far
  std::span<const std::int64_t> sums() const { return sums_; }

 private:
  RasterizerHook& inner_;
  std::vector<std::int64_t> sums_;
  Array<std::uint8_t> all_;
  Array<std::int32_t> drawn_;
  std::vector<std::int32_t> copy_;  ///< of a GPU's
};

double sum_of(std::span<const std::int64_t> values) {
  return static_cast<double>(std::accumulate(values.begin(), values.end(), std::int64_t{0}));
}

/// Keeps candidates of at least `least` flagged pixels whose share of flagged pixels exceeds `factor` times that of
/// all slots together.
void keep_dense_errors(std::span<const std::int64_t> flagged, std::span<const std::int64_t> pixels, double factor,
                       std::int64_t least, std::span<std::uint8_t> candidates) {
  const double threshold = factor * sum_of(flagged) / std::max(1.0, sum_of(pixels));
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const bool dense = static_cast<double>(flagged[i]) > threshold * static_cast<double>(pixels[i]);
    if (!dense || flagged[i] < least) candidates[i] = 0;
  }
}

}  // namespace

ScaffoldAdapter::ScaffoldAdapter(const ScaffoldBoost& boost, Device device)
    : boost_(boost), device_(device), scorer_(device) {
  SPLATBOOST_CHECK(boost.beta > 0.0f && boost.beta <= 1.0f, "beta must lie in (0, 1]");
  SPLATBOOST_CHECK(boost.views > 0, "views must be above 0");
}

std::optional<float> ScaffoldAdapter::beta() const {
  return boost_.cb ? std::optional<float>(boost_.beta) : std::nullopt;
}

void ScaffoldAdapter::grow(const DensityStatistics& statistics, RasterizerHook& rasterizer, GrowDecisions& decisions) {
  // Without a candidate there is nothing to gate, and nothing to draw K views for.
  const bool any =
      std::any_of(decisions.clone.begin(), decisions.clone.end(), [](std::uint8_t wants) { return wants != 0; });
  if (!boost_.vcd || !any) return;
  MultiViewOptions options;
  options.views = boost_.views;
  options.tau = boost_.tau;
  const RandomStream random(boost_.seed, static_cast<std::uint64_t>(statistics.moment.iteration),
                            RandomPurpose::scored_views);
  if (boost_.literal) {
    importance_.resize(rasterizer.primitives());
    importance_scores(scorer_.score(rasterizer, options, random), importance_);
    keep_important(importance_, boost_.tau_d, decisions.clone);
  } else {
    PixelsOfSlots counted(rasterizer, device_);
    const ScoreSums& found = scorer_.score(counted, options, random);
    keep_dense_errors(found.counts, counted.sums(), boost_.tau_d / kImportanceOfMeanShare, found.views,
                      decisions.clone);
  }
}

}  // namespace splatboost

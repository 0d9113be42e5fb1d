// SPDX-License-Identifier: Apache-2.0
/// @file A fake renderer with given counts, to test adapters with known answers.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "splatboost/hooks.h"

namespace splatboost::testing {

/// Renders black views whose left half differs from the truth. A primitive has one count per view, or one for all.
class GivenCounts : public RasterizerHook {
 public:
  GivenCounts(std::vector<std::vector<std::int32_t>> counts, std::size_t views, int width, int height)
      : counts_(std::move(counts)), views_(views), width_(width), height_(height) {
    const auto numbers = static_cast<std::size_t>(3 * width * height);
    color_.assign(numbers, 0.0f);
    for (std::size_t p = 0; p < numbers; ++p) {
      truth_.push_back(static_cast<int>(p % static_cast<std::size_t>(width)) < width / 2 ? 255 : 0);
    }
  }
  void set_beta(std::optional<float>) override {}
  std::size_t primitives() const override { return counts_.size(); }
  std::size_t scorable_views() const override { return views_; }
  ScoredView render_for_score(std::size_t view) override {
    rendered.push_back(view);
    return {color_, {width_, height_, truth_, valid}};
  }
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    const bool whole = valid.empty() ? std::find(flagged.begin(), flagged.end(), std::uint8_t{0}) == flagged.end()
                                     : std::ranges::equal(flagged, valid);
    const auto& given = whole && !drawn.empty() ? drawn : counts_;
    for (std::size_t i = 0; i < counts.size(); ++i) {
      counts[i] += given[i].size() == 1 ? given[i][0] : given[i][rendered.back()];
    }
  }
  void add_weights(std::span<std::int32_t> added) override {
    for (std::size_t i = 0; i < added.size() && !weights.empty(); ++i) added[i] += weights[i];
  }
  std::vector<std::int32_t> weights;  ///< of each primitive in every view; empty: none
  std::vector<std::uint8_t> valid;    ///< [H·W] mask of valid pixels of every view; empty: all
  /// Counts returned if every valid pixel is flagged; empty: the same as otherwise.
  std::vector<std::vector<std::int32_t>> drawn;
  std::vector<std::size_t> rendered;

 private:
  std::vector<std::vector<std::int32_t>> counts_;
  std::size_t views_;
  int width_, height_;
  std::vector<float> color_;
  std::vector<std::uint8_t> truth_;
};

}  // namespace splatboost::testing

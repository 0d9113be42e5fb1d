// SPDX-License-Identifier: Apache-2.0
/// @file What an adapter sees of a backbone, made by hand: statistics, and a renderer whose errors are given.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "splatboost/hooks.h"

namespace splatboost::testing {

/// A renderer whose errors and counts are given. Views are black, and the left half is wrong: in 8×8 views 32 pixels
/// are flagged.
class FakeRasterizer : public RasterizerHook {
 public:
  explicit FakeRasterizer(std::vector<std::int32_t> counts, std::size_t views = 10, int width = 8, int height = 8)
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
    return {color_, {width_, height_, truth_, {}}};
  }
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    flagged_pixels = static_cast<std::size_t>(std::count(flagged.begin(), flagged.end(), 1));
    for (std::size_t i = 0; i < counts.size(); ++i) counts[i] += counts_[i];
  }
  std::vector<std::size_t> rendered;
  std::size_t flagged_pixels = 0;

 private:
  std::vector<std::int32_t> counts_;
  std::size_t views_;
  int width_, height_;
  std::vector<float> color_;
  std::vector<std::uint8_t> truth_;
};

inline constexpr float kExtent = 10;  // the border between small and large is extent × percent_dense

/// Statistics of hand-made Gaussians.
struct Hand {
  std::vector<float> gradients, gradients_abs, opacities, max_scales;
  DensityStatistics at(int iteration) const {
    return {{iteration, 30000}, kExtent, gradients, gradients_abs, opacities, max_scales};
  }
};

}  // namespace splatboost::testing

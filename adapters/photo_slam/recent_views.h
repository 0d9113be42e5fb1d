// SPDX-License-Identifier: Apache-2.0
/// @file Selects views from a growing set, and counts how many of them see each primitive.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "splatboost/array.h"
#include "splatboost/device.h"
#include "splatboost/hooks.h"
#include "splatboost/random.h"

namespace splatboost {

/// min(k, n) of the views 0 … n−1, ascending: the round(share · k) newest, and the others drawn from the rest.
std::vector<std::size_t> recent_and_drawn_views(std::size_t n, int k, double share, const RandomStream& random);

/// Forwards to a rasterizer, with only the given views as its scorable views. Each count_flagged() also replays the
/// view with all of its pixels flagged: the view sees every primitive that is blended anywhere.
class ChosenViews final : public RasterizerHook {
 public:
  ChosenViews(RasterizerHook& rasterizer, std::vector<std::size_t> views, Device device)
      : rasterizer_(rasterizer),
        views_(std::move(views)),
        ones_(device),
        counts_(device),
        seen_(rasterizer.primitives(), 0) {}

  void set_beta(std::optional<float> beta) override { rasterizer_.set_beta(beta); }
  std::size_t primitives() const override { return rasterizer_.primitives(); }
  std::size_t scorable_views() const override { return views_.size(); }
  ScoredView render_for_score(std::size_t view) override;
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override;

  /// [N] number of views, of those passed to count_flagged(), that see each primitive
  std::span<const std::int32_t> seen() const { return seen_; }

 private:
  RasterizerHook& rasterizer_;
  std::vector<std::size_t> views_;
  std::size_t pixels_ = 0;
  Array<std::uint8_t> ones_;
  Array<std::int32_t> counts_;
  std::vector<std::int32_t> seen_;
};

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Fakes of what an adapter sees of a backbone: statistics, and a renderer with known errors.
#pragma once

#include <algorithm>
#include <vector>

#include "support/given_counts.h"

namespace splatboost::testing {

/// One count per primitive, the same in all views. In 8×8 views 32 pixels are flagged.
class FakeRasterizer : public GivenCounts {
 public:
  explicit FakeRasterizer(const std::vector<std::int32_t>& counts, std::size_t views = 10, int width = 8,
                          int height = 8)
      : GivenCounts(one_for_all_views(counts), views, width, height) {}
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    flagged_pixels = static_cast<std::size_t>(std::count(flagged.begin(), flagged.end(), 1));
    GivenCounts::count_flagged(flagged, counts);
  }
  std::size_t flagged_pixels = 0;

 private:
  static std::vector<std::vector<std::int32_t>> one_for_all_views(const std::vector<std::int32_t>& counts) {
    std::vector<std::vector<std::int32_t>> given;
    for (const std::int32_t count : counts) given.push_back({count});
    return given;
  }
};

inline constexpr float kExtent = 10;  // the border between small and large is extent × percent_dense

/// Density statistics of Gaussians with values given by the test.
struct Hand {
  std::vector<float> gradients, gradients_abs, opacities, max_scales, clearances = {};
  DensityStatistics at(int iteration) const {
    return {{iteration, 30000}, kExtent, gradients, gradients_abs, opacities, max_scales, clearances};
  }
};

}  // namespace splatboost::testing

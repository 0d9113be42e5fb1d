// SPDX-License-Identifier: Apache-2.0
/// @file Runs of a few iterations, which a GPU's are compared by with the CPU's.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <vector>

#include "common/backbone.h"
#include "support/backbone_checks.h"

namespace splatboost::test {

/// What a run showed of itself. The loss that a step returns is of an earlier one on a GPU, so what is compared is a
/// picture after each step.
struct Trace {
  std::vector<double> errors;  ///< mean absolute difference of a test view
  std::vector<std::size_t> primitives;
};

inline Trace run_of(Backbone& backbone, const Scene& scene, int first, int last) {
  Trace trace;
  for (int i = first; i <= last; ++i) {
    EXPECT_TRUE(std::isfinite(backbone.train_step(i, testing::view_at(scene, i))));
    const View& shown = scene.test.front();
    const std::vector<float> picture = testing::picture(backbone, shown);
    double sum = 0;
    for (std::size_t p = 0; p < picture.size(); ++p) sum += std::abs(picture[p] - shown.color[p] / 255.0f);
    trace.errors.push_back(sum / static_cast<double>(picture.size()));
    trace.primitives.push_back(backbone.primitives());
  }
  return trace;
}

/// Rounding alone makes runs part after their first growth: Gaussians near each other may change places in memory, and
/// with them the random numbers of the splits to come. @param alike iterations in which they have not
inline void expect_same_run(const Trace& found, const Trace& expected, std::size_t alike) {
  ASSERT_EQ(found.errors.size(), expected.errors.size());
  for (std::size_t i = 0; i < expected.errors.size(); ++i) {
    const double loose = i < alike ? 0.001 : 0.15;
    EXPECT_NEAR(found.errors[i], expected.errors[i], loose * expected.errors[i]) << "iteration " << i + 1;
    const auto primitives = static_cast<double>(expected.primitives[i]);
    EXPECT_NEAR(static_cast<double>(found.primitives[i]), primitives, loose * primitives) << "iteration " << i + 1;
  }
}

/// For the steady loop: no growth, but all statistics.
class NeverGrows : public DensityHook {
  bool needs_absolute_gradients() const override { return true; }
  bool grows_at(Moment, bool) const override { return false; }
  void grow(const DensityStatistics&, RasterizerHook&, GrowDecisions&) override {}
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions&) override {}
};

}  // namespace splatboost::test

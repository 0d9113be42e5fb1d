// SPDX-License-Identifier: Apache-2.0
/// @file Runs of a few iterations, which a GPU's are compared by with the CPU's.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <vector>

#include "common/backbone.h"
#include "support/backbone_checks.h"

namespace splatboost::test {

/// What a run showed of itself.
struct Trace {
  std::vector<double> losses;
  std::vector<std::size_t> primitives;
};

inline Trace run_of(Backbone& backbone, const Scene& scene, int first, int last) {
  Trace trace;
  for (int i = first; i <= last; ++i) {
    trace.losses.push_back(backbone.train_step(i, testing::view_at(scene, i)));
    trace.primitives.push_back(backbone.primitives());
  }
  return trace;
}

/// Rounding alone makes runs part after their first growth: Gaussians near each other may change places in memory, and
/// with them the random numbers of the splits to come. @param alike iterations in which they have not
inline void expect_same_run(const Trace& found, const Trace& expected, std::size_t alike) {
  ASSERT_EQ(found.losses.size(), expected.losses.size());
  for (std::size_t i = 0; i < expected.losses.size(); ++i) {
    const double loose = i < alike ? 0.001 : 0.15;
    EXPECT_NEAR(found.losses[i], expected.losses[i], loose * expected.losses[i]) << "iteration " << i + 1;
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

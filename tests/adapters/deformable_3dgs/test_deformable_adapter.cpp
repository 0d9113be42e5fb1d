// SPDX-License-Identifier: Apache-2.0
// Vanilla's rules over the longer run of Deformable-3DGS, and the net that always steps.
#include "deformable_3dgs/deformable_adapter.h"

#include <gtest/gtest.h>

namespace splatboost {
namespace {

TEST(DeformableAdapter, plan_is_of_the_published_run_of_40000) {
  Threads threads(1);
  const DeformableAdapter adapter(deformable_boost(), threads);
  int first = 0, last = 0;
  std::vector<int> prunes;
  for (int i = 1; i <= 40000; ++i) {
    if (adapter.grows_at({i, 40000}, false)) {
      if (first == 0) first = i;
      last = i;
    }
    if (adapter.prunes_at({i, 40000}, false)) prunes.push_back(i);
  }
  EXPECT_EQ(first, 600);
  EXPECT_EQ(last, 14900);
  EXPECT_EQ(prunes, (std::vector<int>{16000, 20000, 24000, 28000, 32000, 36000})) << "to the end of the run";
  EXPECT_TRUE(adapter.prunes_at({18000, 20000}, false)) << "it scales with the run";
  EXPECT_FALSE(adapter.prunes_at({7000, 20000}, false));
}

TEST(DeformableAdapter, the_net_steps_at_every_iteration) {
  Threads threads(1);
  const DeformableAdapter adapter(deformable_boost(), threads);
  int of_gaussians = 0, of_rest = 0;
  for (int i = 1; i <= 40000; ++i) {
    ASSERT_TRUE(adapter.steps_at("deformation", {i, 40000}));
    of_gaussians += adapter.steps_at("xyz", {i, 40000});
    of_rest += adapter.steps_at("f_rest", {i, 40000});
  }
  EXPECT_LT(of_gaussians, 25000);
  EXPECT_LT(of_rest, 3000);
}

}  // namespace
}  // namespace splatboost

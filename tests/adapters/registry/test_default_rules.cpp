// SPDX-License-Identifier: Apache-2.0
// Default rules in which the adapters of Gaussians differ.
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "registry/boost_settings.h"

namespace splatboost {
namespace {

TEST(DefaultRules, large_gaussians_stay_where_that_was_measured) {
  const std::map<std::string, bool> prunes{{"vanilla", false},        {"mip-splatting", false}, {"dropgaussian", false},
                                           {"deformable-3dgs", true}, {"pgsr", true},           {"photo-slam", true},
                                           {"convex-splatting", true}};
  Threads threads(1);
  for (const auto& [backbone, expected] : prunes) {
    const auto adapter = find_adapter(backbone).make_settings(false)->make_adapter(0, threads);
    EXPECT_EQ(adapter->prunes_large_at({5000, 30000}, true), expected) << backbone;
    EXPECT_FALSE(adapter->prunes_large_at({5000, 30000}, false)) << backbone;
  }
}

}  // namespace
}  // namespace splatboost

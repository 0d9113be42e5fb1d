// SPDX-License-Identifier: Apache-2.0
// Default rules in which the adapters of Gaussians differ.
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <string>
#include <string_view>

#include "registry/boost_settings.h"

namespace splatboost {
namespace {

TEST(DefaultRules, large_gaussians_stay_where_that_was_measured) {
  const std::map<std::string, bool> prunes{
      {"vanilla", false}, {"mip-splatting", false}, {"dropgaussian", false},   {"deformable-3dgs", false},
      {"pgsr", false},    {"photo-slam", true},     {"convex-splatting", true}};
  Threads threads(1);
  for (const auto& [backbone, expected] : prunes) {
    const auto adapter = find_adapter(backbone).make_settings(false)->make_adapter(0, threads);
    EXPECT_EQ(adapter->prunes_large_at({5000, 30000}, true), expected) << backbone;
    EXPECT_FALSE(adapter->prunes_large_at({5000, 30000}, false)) << backbone;
  }
}

TEST(DefaultRules, lengths_are_scaled_where_the_published_ones_are_in_world_units) {
  const std::set<std::string_view> kInWorldUnits{"scaffold-gs", "octree-gs", "convex-splatting"};
  for (const AdapterEntry& entry : adapters()) {
    EXPECT_EQ(entry.make_settings(false)->scales_lengths(), kInWorldUnits.contains(entry.backbone)) << entry.backbone;
    EXPECT_FALSE(entry.make_settings(true)->scales_lengths()) << entry.backbone;
  }
}

TEST(DefaultRules, parameters_are_averaged_at_the_end_where_that_was_measured) {
  const std::set<std::string_view> kWithAverages{"vanilla", "mip-splatting",   "dropgaussian",
                                                 "pgsr",    "deformable-3dgs", "convex-splatting"};
  Threads threads(1);
  for (const AdapterEntry& entry : adapters()) {
    const auto adapter = entry.make_settings(false)->make_adapter(0, threads);
    const bool gains = kWithAverages.contains(entry.backbone);
    EXPECT_EQ(adapter->averages_at({30000, 30000}), gains) << entry.backbone;
    EXPECT_FALSE(adapter->averages_at({28000, 30000})) << entry.backbone;
    const auto literal = entry.make_settings(true)->make_adapter(0, threads);
    EXPECT_FALSE(literal->averages_at({30000, 30000})) << entry.backbone;
  }
}

}  // namespace
}  // namespace splatboost

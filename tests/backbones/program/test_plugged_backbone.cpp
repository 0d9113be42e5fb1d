// SPDX-License-Identifier: Apache-2.0
#include "program/session/plugged_backbone.h"

#include <vector>

#include <gtest/gtest.h>

#include "support/tiny_scene.h"
#include "trainer/dataset/scene_depths.h"

namespace splatboost::program {
namespace {

std::vector<float> points_in_a_cube(std::size_t count) {
  const RandomStream random(1, 0, RandomPurpose::synth);
  std::vector<float> points(3 * count);
  for (std::size_t i = 0; i < points.size(); ++i) points[i] = static_cast<float>(2 * random.uniform(i) - 1);
  return points;
}

TEST(PluggedBackbone, the_adapter_knows_how_often_views_are_used) {
  Threads threads(1);
  const Scene scene = testing::tiny_scene(threads, 4);  // three for training
  const auto factor = [&](int iterations) {
    const nlohmann::json none = nlohmann::json::object();
    return make_backbone("vanilla", {scene, threads, 0, iterations}, none, &none)
        .adapter->rate_factor("f_rest", {100, iterations});
  };
  EXPECT_EQ(factor(90), 4) << "30 uses";
  EXPECT_EQ(factor(900), 2) << "300 uses";
}

TEST(PluggedBackbone, the_adapter_knows_how_far_the_scene_is) {
  Threads threads(1);
  Scene scene = testing::tiny_scene(threads, 4);
  const auto factor = [&](const char* name, double extent) {
    scene.extent = static_cast<float>(extent * typical_depth(scene));
    const nlohmann::json none = nlohmann::json::object();
    return make_backbone(name, {scene, threads, 0, 900}, none, &none).adapter->rate_factor("xyz", {100, 900});
  };
  for (const char* name : {"vanilla", "mip-splatting", "dropgaussian", "pgsr"}) {
    EXPECT_EQ(factor(name, 1), 1) << name;
    EXPECT_FLOAT_EQ(factor(name, 0.1), 8) << name;
  }
}

TEST(PluggedBackbone, lengths_are_scaled_to_the_scene) {
  Threads threads(1);
  const Scene scene = testing::tiny_scene(threads, 2);
  const nlohmann::json none = nlohmann::json::object(), off = {{"scale_lengths", false}}, literal = {{"literal", true}};
  const nlohmann::json own = {{"absolute_distances", true}};
  const auto absolute = [&](const char* name, const nlohmann::json& constants, const nlohmann::json* boost) {
    return make_backbone(name, {scene, threads, 0, 900}, constants, boost).backbone->config()["absolute_distances"];
  };
  for (const char* name : {"scaffold-gs", "octree-gs", "convex-splatting"}) {
    EXPECT_EQ(absolute(name, none, &none), false) << name;
    EXPECT_EQ(absolute(name, own, &none), true) << name << ": a user's own choice";
    EXPECT_EQ(absolute(name, none, &off), true) << name;
    EXPECT_EQ(absolute(name, none, &literal), true) << name;
    EXPECT_EQ(absolute(name, none, nullptr), true) << name << ": as published";
  }
}

TEST(PluggedBackbone, random_points_let_opacities_be_reset) {
  Threads threads(1);
  Scene scene = testing::tiny_scene(threads, 2);
  const auto resets = [&](const char* name, const std::vector<float>& points) {
    scene.points.positions = points;
    scene.points.colors.assign(points.size(), 128);
    const nlohmann::json none = nlohmann::json::object();
    return make_backbone(name, {scene, threads, 0, 7000}, none, &none).adapter->resets_opacities_at({700, 7000}, true);
  };
  const std::vector<float> random = points_in_a_cube(1000);
  std::vector<float> plane = random;
  for (std::size_t i = 0; i < plane.size(); i += 3) plane[i] = 1;
  for (const char* name : {"vanilla", "mip-splatting"}) {
    EXPECT_TRUE(resets(name, random)) << name;
    EXPECT_FALSE(resets(name, plane)) << name;
  }
}

TEST(PluggedBackbone, nothing_is_pruned_late_while_the_backbone_grows) {
  Threads threads(1);
  const Scene scene = testing::tiny_scene(threads, 2);
  const nlohmann::json longer = {{"densify_until", 20000}};
  const auto prunes = [&](const nlohmann::json& boost, int iteration) {
    return make_backbone("vanilla", {scene, threads, 0, 30000}, longer, &boost)
        .adapter->prunes_at({iteration, 30000}, false);
  };
  const nlohmann::json without = {{"vcd", false}};
  EXPECT_FALSE(prunes(without, 15000));
  EXPECT_FALSE(prunes(without, 18000));
  EXPECT_TRUE(prunes(without, 20000));
  EXPECT_TRUE(prunes(nlohmann::json::object(), 7500)) << "with VCD the adapter decides when growth ends";
}

}  // namespace
}  // namespace splatboost::program

// SPDX-License-Identifier: Apache-2.0
// Numbers of the published 3DGS that every backbone of Gaussians shares: learning rates, geometry of growth,
// background.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <glm/gtc/quaternion.hpp>

#include "splatboost/random.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "vanilla/vanilla.h"

namespace splatboost {
namespace {

using testing::exported;
using testing::state_of;

TEST(VanillaConfig, defaults_are_published) {
  // Kerbl et al. 2023 and arguments/__init__.py of its release; the last four are in its code.
  const nlohmann::json published{{"release", "2023"},
                                 {"sh_degree", 3},
                                 {"position_rate_initial", 1.6e-4},
                                 {"position_rate_final", 1.6e-6},
                                 {"feature_rate", 2.5e-3},
                                 {"opacity_rate", 0.05},
                                 {"scaling_rate", 5e-3},
                                 {"rotation_rate", 1e-3},
                                 {"lambda_dssim", 0.2},
                                 {"percent_dense", 0.01},
                                 {"gradient_threshold", 2e-4},
                                 {"densify_from", 500},
                                 {"densify_until", 15000},
                                 {"densify_interval", 100},
                                 {"opacity_reset_interval", 3000},
                                 {"sh_interval", 1000},
                                 {"min_opacity", 0.005},
                                 {"max_world_scale", 0.1},
                                 {"initial_opacity", 0.1},
                                 {"reset_opacity", 0.01}};
  EXPECT_EQ(to_json(VanillaConfig{}), published);
  EXPECT_EQ(VanillaConfig{}.published_iterations, 30000);
}

class VanillaRun : public ::testing::Test {
 protected:
  static constexpr int kIterations = 600;  // 1/50 of the published run

  std::unique_ptr<Backbone> make(const VanillaConfig& config, int iterations = kIterations) {
    return make_vanilla({scene_, threads_, 3, iterations, 0}, config);
  }

  Threads threads_{2};
  Scene scene_ = testing::tiny_scene(threads_);
};

TEST_F(VanillaRun, every_group_steps_at_its_published_rate) {
  VanillaConfig config;
  config.sh_interval = 1;  // degree 1 from the first iteration on, so that f_rest has gradients
  SplatCloud cloud = exported(*make(config, 30000));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.log_scales[3 * i] += 1;  // a sphere has no gradient of its rotation
    for (std::size_t c = 0; c < 4; ++c) cloud.rotations[4 * i + c] = c == 0 ? 0.7f : 0.4f;
  }
  // Positions: 1.6e-4 falls to 1.6e-6, by the same factor in each half of the run.
  for (const auto& [iteration, position_rate] : {std::pair(1, 1.6e-4), {15000, 1.6e-5}, {30000, 1.6e-6}}) {
    const auto backbone = make(config, 30000);
    testing::import_cloud(*backbone, cloud);
    const auto values = [&](const std::string& group) { return state_of(*backbone, group + ".values"); };
    const std::map<std::string, double> rates{{"xyz", position_rate * static_cast<double>(scene_.extent)},
                                              {"f_dc", 2.5e-3},
                                              {"f_rest", 2.5e-3 / 20},
                                              {"opacity", 0.05},
                                              {"scaling", 5e-3},
                                              {"rotation", 1e-3}};
    std::map<std::string, std::vector<float>> before;
    for (const auto& [group, rate] : rates) before[group] = values(group);
    backbone->train_step(iteration, scene_.train[0]);
    for (const auto& [group, rate] : rates) {
      // Adam's first step has the length of the rate, whatever the gradient.
      const std::vector<float> after = values(group);
      ASSERT_EQ(after.size(), before[group].size());
      double longest = 0, largest = 0;
      for (std::size_t k = 0; k < after.size(); ++k) {
        longest = std::max(longest, std::abs(static_cast<double>(after[k]) - static_cast<double>(before[group][k])));
        largest = std::max(largest, std::abs(static_cast<double>(after[k])));
      }
      EXPECT_NEAR(longest, rate, 2e-4 * rate + 1.2e-7 * largest) << group << " at iteration " << iteration;
    }
  }
}

TEST_F(VanillaRun, an_empty_view_shows_the_background_of_the_scene) {
  testing::expect_background_of_the_scene(
      [&](const Scene& scene) {
        return make_vanilla({scene, threads_, 3, kIterations, 0}, {});
      },
      scene_);
}

TEST_F(VanillaRun, opacities_are_reset_where_growth_begins_only_on_white) {
  testing::expect_early_reset_only_on_white(
      [&](const Scene& scene) {
        return make_vanilla({scene, threads_, 3, kIterations, 0}, {});
      },
      scene_, 10, 0.01);
  VanillaConfig config;
  config.densify_from = 0;  // growth begins before the first iteration, so this reset has none
  scene_.white_background = true;
  const auto backbone = make(config);
  testing::train(*backbone, scene_, 1, 9);
  EXPECT_GT(std::ranges::max(state_of(*backbone, "opacity.values")), -3);
}

/// Grows at once, by opacity: above 0.7 by a split, above 0.4 by a clone. Removes nothing.
class GrowsByOpacity : public DensityHook {
 public:
  bool grows_at(Moment, bool) const override { return true; }
  void grow(const DensityStatistics& statistics, RasterizerHook&, GrowDecisions& decisions) override {
    for (std::size_t i = 0; i < statistics.opacities.size(); ++i) {
      const float opacity = statistics.opacities[i];
      decisions.split[i] = opacity > 0.7f;
      decisions.clone[i] = opacity > 0.4f && opacity <= 0.7f;
    }
  }
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions& decisions) override {
    std::ranges::fill(decisions.remove, std::uint8_t{0});
  }
};

/// Leaves the parameters as they are.
class StandsStill : public OptimizerHook {
 public:
  bool steps_at(std::string_view, Moment) const override { return true; }
  float rate_factor(std::string_view, Moment) const override { return 0; }
};

TEST_F(VanillaRun, averages_follow_their_gaussians_and_begin_again_when_some_are_added) {
  /// Removes every other Gaussian at one iteration, and grows at another.
  class Changes : public DensityHook {
   public:
    Changes(int prunes_at, int grows_at) : prunes_at_(prunes_at), grows_at_(grows_at) {}
    bool grows_at(Moment moment, bool) const override { return moment.iteration == grows_at_; }
    void grow(const DensityStatistics&, RasterizerHook&, GrowDecisions& decisions) override {
      std::ranges::fill(decisions.clone, std::uint8_t{1});
      std::ranges::fill(decisions.split, std::uint8_t{0});
    }
    bool prunes_at(Moment moment, bool) const override { return moment.iteration == prunes_at_; }
    void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions& decisions) override {
      std::ranges::fill(decisions.remove, std::uint8_t{0});
      if (decisions.rule != PruneRule::late) return;
      for (std::size_t i = 1; i < decisions.remove.size(); i += 2) decisions.remove[i] = 1;
    }

   private:
    int prunes_at_, grows_at_;
  };
  constexpr int kNever = 1000;
  testing::AveragesFrom averages(8);
  const auto opacities = [](const Backbone& backbone) { return state_of(backbone, "opacity.values"); };
  for (const bool grows : {false, true}) {
    Changes changes(grows ? kNever : 9, grows ? 9 : kNever);
    const auto backbone = make({});
    backbone->set_hooks(&changes, &averages);
    testing::train(*backbone, scene_, 1, 8);
    const std::vector<float> first = opacities(*backbone);
    testing::train(*backbone, scene_, 9, 9);
    const std::vector<float> second = opacities(*backbone);
    testing::train(*backbone, scene_, 10, 10);
    const std::vector<float> third = opacities(*backbone);
    backbone->finish();
    const std::vector<float> found = opacities(*backbone);
    if (grows) {
      EXPECT_EQ(found, third) << "values of before growth are not part of the mean";
      continue;
    }
    ASSERT_EQ(found.size(), (first.size() + 1) / 2);
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_NEAR(found[i], (first[2 * i] + second[i] + third[i]) / 3, 1e-5f) << i;
    }
  }
}

/// All parameters of a Gaussian except those that a split changes: colour, opacity, rotation.
std::vector<float> kept_of(const SplatCloud& cloud, std::size_t i) {
  std::vector<float> row{cloud.logit_opacities[i]};
  const auto add = [&](const std::vector<float>& values, std::size_t width) {
    for (std::size_t c = 0; c < width; ++c) row.push_back(values[width * i + c]);
  };
  add(cloud.sh_dc, 3);
  add(cloud.sh_rest, 3 * static_cast<std::size_t>(cloud.sh_rest_rows));
  add(cloud.rotations, 4);
  return row;
}

TEST_F(VanillaRun, clones_are_copies_and_children_of_splits_are_samples_of_their_parent) {
  constexpr int kAt = 20;
  SplatCloud cloud;
  // Two that are split, elongated and rotated, the quaternions not of unit length; one that is cloned; one more.
  cloud.logit_opacities = {2.5f, 0, 1.5f, -2};
  cloud.means = {-0.5f, 0.1f, 0, 0.3f, 0.2f, 0.4f, 0.5f, -0.3f, 0.2f, 0, 0.6f, -0.4f};
  cloud.log_scales = {-1, -3, -4, -2.5f, -2, -3, -3.5f, -1.2f, -2, -2, -2, -2};
  cloud.rotations = {1.6f, 0.8f, -0.8f, 0.4f, 0.5f, 0.5f, 0.5f, -0.5f, 0.3f, -0.2f, 0.5f, 0.4f, 1, 0, 0, 0};
  cloud.sh_rest_rows = 15;
  for (int k = 0; k < 4 * 3; ++k) cloud.sh_dc.push_back(0.1f * static_cast<float>(k));
  for (int k = 0; k < 4 * 45; ++k) cloud.sh_rest.push_back(0.001f * static_cast<float>(k));
  const auto backbone = make({});
  testing::import_cloud(*backbone, cloud);
  GrowsByOpacity grows;
  StandsStill still;
  backbone->set_hooks(&grows, &still);
  backbone->train_step(kAt, scene_.train[0]);
  const SplatCloud grown = exported(*backbone);
  ASSERT_EQ(grown.size(), 2u * 2 + 2 + 1) << "two children each without their parents, an original and its clone, one";

  const auto rows_like = [&](std::size_t original) {
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < grown.size(); ++i) {
      if (kept_of(grown, i) == kept_of(cloud, original)) rows.push_back(i);
    }
    return rows;
  };
  const auto part = [](const std::vector<float>& values, std::size_t i) {
    return std::vector<float>(&values[3 * i], &values[3 * i] + 3);
  };
  ASSERT_EQ(rows_like(1).size(), 2u);
  ASSERT_EQ(rows_like(3).size(), 1u);
  for (const std::size_t original : {1u, 3u}) {
    for (const std::size_t row : rows_like(original)) {
      EXPECT_EQ(part(grown.means, row), part(cloud.means, original));
      EXPECT_EQ(part(grown.log_scales, row), part(cloud.log_scales, original));
    }
  }
  // Samples of the parent's distribution, with scales divided by 0.8·2. Random numbers are taken in the order child,
  // parent, axis.
  const RandomStream random(3, kAt, RandomPurpose::split);
  constexpr std::size_t kParents[2] = {0, 2};
  for (std::size_t p = 0; p < 2; ++p) {
    const std::size_t parent = kParents[p];
    const std::vector<std::size_t> rows = rows_like(parent);
    ASSERT_EQ(rows.size(), 2u);
    const float* q = &cloud.rotations[4 * parent];
    const glm::dmat3 rotation = glm::mat3_cast(glm::normalize(glm::dquat(q[0], q[1], q[2], q[3])));
    std::set<std::size_t> found;
    for (std::uint64_t child = 0; child < 2; ++child) {
      glm::dvec3 sample;
      for (int c = 0; c < 3; ++c) {
        sample[c] = std::exp(static_cast<double>(cloud.log_scales[3 * parent + static_cast<std::size_t>(c)])) *
                    random.normal(3 * (2 * child + p) + static_cast<std::uint64_t>(c));
      }
      const glm::dvec3 offset = rotation * sample;
      for (const std::size_t row : rows) {
        double distance = 0;
        for (std::size_t c = 0; c < 3; ++c) {
          const auto moved = static_cast<double>(grown.means[3 * row + c]) - cloud.means[3 * parent + c];
          distance = std::max(distance, std::abs(moved - offset[static_cast<int>(c)]));
        }
        if (distance < 1e-6) found.insert(row);
      }
      EXPECT_EQ(found.size(), child + 1) << "child " << child << " of Gaussian " << parent;
    }
    for (const std::size_t row : rows) {
      for (std::size_t c = 0; c < 3; ++c) {
        EXPECT_NEAR(grown.log_scales[3 * row + c], cloud.log_scales[3 * parent + c] - std::log(1.6), 1e-6);
      }
    }
  }
}

}  // namespace
}  // namespace splatboost

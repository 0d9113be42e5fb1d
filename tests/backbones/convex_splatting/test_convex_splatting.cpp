// SPDX-License-Identifier: Apache-2.0
// 3D Convex Splatting in training: its published decisions, its children, masks, resume, files, quality.
#include "convex_splatting/convex_splatting.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "convex_splatting/convex_file.h"
#include "convex_splatting/convex_mesh.h"
#include "convex_splatting/convex_shapes.h"
#include "support/backbone_checks.h"
#include "support/density_recorder.h"
#include "support/tiny_scene.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/dataset/scene_depths.h"

namespace splatboost {

BackboneEntry convex_splatting_entry();

namespace {

using testing::DensityEvent;
using testing::DensityRecorder;
using testing::state_of;
using testing::view_at;

float sigmoid(float x) { return 1 / (1 + std::exp(-x)); }

/// Records the masks too.
class MaskRecorder : public DensityRecorder {
 public:
  void prune(const DensityStatistics& s, RasterizerHook& r, PruneDecisions& d) override {
    DensityRecorder::prune(s, r, d);
    masks.push_back(read_masks());
  }
  std::function<std::vector<float>()> read_masks;
  std::vector<std::vector<float>> masks;  ///< one entry per removal
};

class ConvexRun : public ::testing::Test {
 protected:
  static constexpr int kIterations = 600;  // 1/50 of the published run

  static ConvexConfig eager() {
    ConvexConfig config;
    config.densify_interval = 10;
    config.reference_focal = 600;  // the views are tiny
    config.gradient_threshold = 2e-6;
    return config;
  }
  std::unique_ptr<Backbone> make(const ConvexConfig& config, int iterations = kIterations, std::size_t cap = 0) {
    return make_convex_splatting({scene_, threads_, 3, iterations, cap}, config);
  }
  ConvexCloud exported(const Backbone& backbone) const {
    const test::TemporaryFolder folder;
    backbone.export_model(folder.path());
    return read_convexes(folder.path());
  }

  Threads threads_{2};
  Scene scene_ = testing::tiny_scene(threads_);
};

TEST_F(ConvexRun, LengthsAreForTheSceneAndTheLengthOfTheRun) {
  const auto sharpness = [&](bool absolute, int iterations) {
    ConvexConfig config = eager();
    config.absolute_distances = absolute;
    return std::exp(exported(*make(config, iterations)).log_sharpness.at(0));
  };
  const auto moved = [&](bool absolute) {  // by one step of Adam, which is the rate
    ConvexConfig config = eager();
    config.absolute_distances = absolute;
    const auto backbone = make(config);
    const std::vector<float> before = exported(*backbone).points;
    testing::train(*backbone, scene_, 1, 1);
    const std::vector<float> after = exported(*backbone).points;
    float most = 0;
    for (std::size_t i = 0; i < before.size(); ++i) most = std::max(most, std::abs(after[i] - before[i]));
    return most;
  };
  const auto unit = static_cast<float>(typical_depth(scene_) / kConvexDepth);
  EXPECT_NEAR(sharpness(true, 600), 9e-4f, 1e-8f);
  EXPECT_NEAR(sharpness(false, 30000) * unit, 9e-4f, 1e-8f);
  EXPECT_NEAR(sharpness(false, 60000) * unit, 9e-4f, 1e-8f);
  EXPECT_NEAR(sharpness(false, 15000) * unit * 2, 9e-4f, 1e-8f) << "half as long";
  EXPECT_NEAR(sharpness(false, 600) * unit * 4, 9e-4f, 1e-8f) << "at most four times";
  EXPECT_NEAR(moved(false) / moved(true), 4 * unit, 0.01f);
}

TEST_F(ConvexRun, DecidesByThePublishedRules) {
  MaskRecorder recorder;
  ConvexConfig config = eager();
  config.mask_rate = 0.2;  // so that masks fall below the threshold within the test
  config.lambda_mask = 5;
  const auto backbone = make(config, kIterations, 900);
  recorder.read_masks = [&] { return state_of(*backbone, "mask.values"); };
  backbone->set_hooks(&recorder, nullptr);
  testing::train(*backbone, scene_, 1, 260);

  std::set<int> growths, prunes, trims, expected, expected_trims;
  for (int i = 20; i < 190; i += 10) expected.insert(i);
  for (int i = 200; i <= 260; i += 20) expected_trims.insert(i);
  std::size_t splits = 0, faint = 0, masked = 0, removals = 0;
  for (const DensityEvent& e : recorder.events) {
    if (e.growth) {
      growths.insert(e.iteration);
      for (std::size_t i = 0; i < e.split.size(); ++i) {
        EXPECT_EQ(e.split[i] != 0, e.gradients[i] >= 2e-6f) << "the signed gradient decides";
        EXPECT_EQ(e.clone[i], 0) << "nothing is cloned";
        splits += e.split[i];
      }
      continue;
    }
    const std::vector<float>& masks = recorder.masks[removals++];
    const bool grew = e.rule == PruneRule::growth;
    (grew ? prunes : trims).insert(e.iteration);
    for (std::size_t i = 0; i < e.remove.size(); ++i) {
      const bool is_faint = e.opacities[i] < 0.03f, is_masked = sigmoid(masks[i]) <= 0.02f;
      const bool is_large =
          grew && e.iteration > 60 && static_cast<double>(e.max_scales[i]) > 0.3 * static_cast<double>(scene_.extent);
      if (!is_large) {
        EXPECT_EQ(e.remove[i] != 0, is_faint || is_masked) << e.iteration;
      }
      faint += is_faint ? 1 : 0;
      masked += is_masked ? 1 : 0;
    }
  }
  EXPECT_EQ(growths, expected);
  EXPECT_EQ(prunes, expected);
  EXPECT_EQ(trims, expected_trims);
  EXPECT_GT(splits, 20u) << "the scene must exercise the rules";
  EXPECT_GT(faint, 0u);
  EXPECT_GT(masked, 0u);
}

TEST_F(ConvexRun, RemovesNothingAtTheEnd) {
  MaskRecorder recorder;
  const auto backbone = make(eager(), 60);  // trims every 2 iterations after growth
  recorder.read_masks = [&] { return state_of(*backbone, "mask.values"); };
  backbone->set_hooks(&recorder, nullptr);
  testing::train(*backbone, scene_, 1, 60);
  std::set<int> trims;
  for (const DensityEvent& e : recorder.events) {
    if (e.rule == PruneRule::trim) trims.insert(e.iteration);
  }
  EXPECT_TRUE(trims.contains(58));
  EXPECT_FALSE(trims.contains(60)) << "nothing would make up for it";
}

TEST_F(ConvexRun, SplitsIntoSixAtThePointsOfTheParent) {
  ConvexConfig config = eager();
  config.min_opacity = 0;  // nothing else is removed
  config.min_mask = 0;
  class One : public DensityRecorder {
   public:
    void grow(const DensityStatistics& s, RasterizerHook& r, GrowDecisions& d) override {
      std::fill(d.split.begin(), d.split.end(), std::uint8_t{0});
      d.split[7] = 1;
      before = look();
      DensityRecorder::grow(s, r, d);
    }
    void prune(const DensityStatistics& s, RasterizerHook& r, PruneDecisions& d) override {
      if (!events.empty() && events.back().growth) {
        after = look();
        origins.assign(d.origins.begin(), d.origins.end());
      }
      DensityRecorder::prune(s, r, d);
    }
    std::function<ConvexCloud()> look;
    ConvexCloud before, after;
    std::vector<std::uint32_t> origins;
  } hook;
  const auto backbone = make(config);
  hook.look = [&] { return exported(*backbone); };
  backbone->set_hooks(&hook, nullptr);
  testing::train(*backbone, scene_, 1, 20);
  const ConvexCloud &before = hook.before, &after = hook.after;
  ASSERT_EQ(after.size(), before.size() + 5);
  const float* const parent = &before.points[kConvexWidth * 7];
  const std::vector<float> centre = convex_centres({parent, kConvexWidth});
  std::set<std::size_t> numbers;
  for (std::size_t i = 0; i < after.size(); ++i) {
    if (hook.origins[i] != 7) {
      EXPECT_EQ(after.log_sharpness[i], before.log_sharpness[hook.origins[i]]);
      continue;
    }
    const float* const child = &after.points[kConvexWidth * i];
    const std::vector<float> own = convex_centres({child, kConvexWidth});
    for (std::size_t k = 0; k < kConvexPoints; ++k) {
      const auto at = [&](std::size_t c) { return std::abs(own[c] - parent[3 * k + c]) < 1e-5f; };
      if (at(0) && at(1) && at(2)) numbers.insert(k);
    }
    for (std::size_t k = 0; k < kConvexWidth; ++k) {
      EXPECT_NEAR(child[k] - own[k % 3], 0.7f * (parent[k] - centre[k % 3]), 1e-5f);
    }
    EXPECT_FLOAT_EQ(after.log_sharpness[i], 0.85f * before.log_sharpness[7]) << "of the logarithm";
    EXPECT_EQ(after.log_smoothness[i], before.log_smoothness[7]);
    EXPECT_EQ(after.logit_masks[i], before.logit_masks[7]);
    EXPECT_NEAR(sigmoid(after.logit_opacities[i]), 0.5f * sigmoid(before.logit_opacities[7]), 1e-6f);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_EQ(after.sh_dc[3 * i + c], before.sh_dc[21 + c]);
  }
  EXPECT_EQ(numbers.size(), 6u) << "one child at each point";
}

TEST_F(ConvexRun, ResetsOpacitiesWhileItGrows) {
  ConvexConfig config = eager();
  config.initial_opacity = 0.6;
  config.densify_from = 14000;
  const auto backbone = make(config);
  const auto highest = [&] {
    const std::vector<float> logits = state_of(*backbone, "opacity.values");
    return sigmoid(*std::max_element(logits.begin(), logits.end()));
  };
  testing::train(*backbone, scene_, 1, 59);
  EXPECT_GT(highest(), 0.4f);
  testing::train(*backbone, scene_, 60, 60);
  EXPECT_NEAR(highest(), 0.2f, 1e-4f);
}

TEST_F(ConvexRun, ResetsOpacitiesWhereGrowthBeginsOnlyOnWhite) {
  ConvexConfig config = eager();
  config.initial_opacity = 0.6;
  testing::expect_early_reset_only_on_white(
      [&](const Scene& scene) {
        return make_convex_splatting({scene, threads_, 3, kIterations, 0}, config);
      },
      scene_, 10, 0.2);
}

TEST_F(ConvexRun, AnEmptyViewShowsTheBackgroundOfTheScene) {
  testing::expect_background_of_the_scene(
      [&](const Scene& scene) {
        return make_convex_splatting({scene, threads_, 3, kIterations, 0}, eager());
      },
      scene_);
}

TEST_F(ConvexRun, AMaskBelowItsThresholdHides) {
  const auto backbone = make(eager());
  testing::train(*backbone, scene_, 1, 30);
  const std::vector<float> drawn = testing::picture(*backbone, scene_.test[0]);
  const test::TemporaryFolder folder;
  ConvexCloud cloud = exported(*backbone);
  std::fill(cloud.logit_masks.begin(), cloud.logit_masks.end(), std::log(0.011f / 0.989f));
  write_convexes(folder.path(), cloud);
  const auto shown = make(eager());
  shown->import_model(folder.path());
  const std::vector<float> same = testing::picture(*shown, scene_.test[0]);
  std::fill(cloud.logit_masks.begin(), cloud.logit_masks.end(), std::log(0.009f / 0.991f));
  write_convexes(folder.path(), cloud);
  shown->import_model(folder.path());
  for (const float value : testing::picture(*shown, scene_.test[0])) ASSERT_EQ(value, 0.0f);
  double brightest = 0;
  for (const float value : same) brightest = std::max(brightest, static_cast<double>(value));
  EXPECT_GT(brightest, 0.1);
}

TEST_F(ConvexRun, GoesOnExactlyAfterACut) {
  const auto make_one = [&] { return make(eager(), 60, 300); };
  testing::expect_exact_resume(make_one, scene_, 60, {13, 20, 40});
}

TEST_F(ConvexRun, GoesOnExactlyWhileGradientsAccumulate) {
  class EveryFourth : public OptimizerHook {
   public:
    bool steps_at(std::string_view group, Moment moment) const override {
      return group == "sigma" || moment.iteration % 4 == 0;
    }
  } hook;
  testing::expect_exact_resume([&] { return make(eager(), 40, 200); }, scene_, 40, {13}, &hook);
}

TEST_F(ConvexRun, AveragesEndARun) {
  testing::expect_averages_at_the_end([&] { return make(eager(), 60, 300); }, scene_, 38,
                                      {"convex_points", "sigma", "mask"});
}

TEST_F(ConvexRun, SameBytesForAnyNumberOfThreads) {
  testing::expect_same_bytes_for_any_threads(
      [&](const Threads& threads) {
        return make_convex_splatting({scene_, threads, 3, 60, 300}, eager());
      },
      scene_, 50);
}

TEST_F(ConvexRun, AHookThatChangesNothingChangesNothing) {
  DensityRecorder recorder;
  const auto plain = make(eager(), 60), hooked = make(eager(), 60);
  hooked->set_hooks(&recorder, nullptr);
  testing::train(*plain, scene_, 1, 50);
  testing::train(*hooked, scene_, 1, 50);
  EXPECT_EQ(testing::model_bytes(*plain), testing::model_bytes(*hooked));
  testing::expect_rates_times_factor(*make(eager(), 60), scene_, "mask", "sigma");
}

TEST_F(ConvexRun, HoldsTheCap) {
  ConvexConfig config = eager();
  config.gradient_threshold = -1;  // all are candidates for a split
  const auto backbone = make(config, kIterations, 123);
  for (int i = 1; i <= 60; ++i) {
    backbone->train_step(i, view_at(scene_, i));
    ASSERT_LE(backbone->primitives(), 123u) << i;
  }
  EXPECT_GT(backbone->primitives(), 100u);
  EXPECT_EQ(make(config, kIterations, 7)->primitives(), 7u);
}

TEST_F(ConvexRun, ModelsAreReadBack) {
  const auto backbone = make(eager(), 40);
  testing::train(*backbone, scene_, 1, 40);
  backbone->finish();
  const test::TemporaryFolder folder;
  EXPECT_GT(backbone->export_model(folder.path()), 1000u);
  const auto other = make(eager(), 40);
  other->import_model(folder.path());
  EXPECT_EQ(testing::picture(*other, scene_.test[0]), testing::picture(*backbone, scene_.test[0]));
  EXPECT_EQ(testing::model_bytes(*other), testing::model_bytes(*backbone));
}

TEST_F(ConvexRun, DrawsTheSameAtOtherSizes) {
  for (const double reference : {0.0, 600.0}) {
    ConvexConfig config = eager();
    config.reference_focal = reference;
    const auto backbone = make(config, 100);
    testing::train(*backbone, scene_, 1, 40);
    View half = scene_.test[0];
    for (float* value : {&half.camera.fx, &half.camera.fy, &half.camera.cx, &half.camera.cy}) *value /= 2;
    half.camera.width /= 2;
    half.camera.height /= 2;
    half.color.resize(half.color.size() / 4);
    const std::vector<float> full = testing::picture(*backbone, scene_.test[0]),
                             small = testing::picture(*backbone, half);
    double sum_full = 0, sum_small = 0;
    for (const float value : full) sum_full += static_cast<double>(value) / static_cast<double>(full.size());
    for (const float value : small) sum_small += static_cast<double>(value) / static_cast<double>(small.size());
    EXPECT_NEAR(sum_small / sum_full, 1, 0.03) << reference;
  }
}

TEST_F(ConvexRun, ReachesAStatedQuality) {
  ConvexConfig config = eager();
  config.densify_interval = 20;
  const auto backbone = make(config, 400, 600);
  testing::train(*backbone, scene_, 1, 400);
  backbone->finish();
  double error = 0, count = 0;
  for (const View& view : scene_.test) {
    const std::vector<float> image = testing::picture(*backbone, view);
    for (std::size_t k = 0; k < image.size(); ++k) {
      const double d = std::clamp(static_cast<double>(image[k]), 0.0, 1.0) - view.color[k] / 255.0;
      error += d * d;
      count += 1;
    }
  }
  EXPECT_GT(-10 * std::log10(error / count), 19.0);
}

TEST(ConvexConfigs, PresetsAreTheReleases) {
  const ConvexConfig indoor = convex_config_from_json(nlohmann::json::object());
  EXPECT_EQ(indoor.gradient_threshold, 6e-6);
  EXPECT_EQ(indoor.densify_until, 9500);
  EXPECT_EQ(indoor.reference_focal, 1000);
  const ConvexConfig outdoor = convex_config_from_json({{"preset", "outdoor"}});
  EXPECT_EQ(outdoor.gradient_threshold, 1e-6);
  EXPECT_EQ(outdoor.initial_sharpness, 1e-3);
  EXPECT_EQ(outdoor.sharpness_rate, 4e-3);
  EXPECT_EQ(outdoor.child_size, 0.6);
  EXPECT_EQ(outdoor.child_log_sharpness, 0.88);
  EXPECT_EQ(outdoor.points_rate_initial, 5e-4);
  EXPECT_EQ(outdoor.densify_until, 9000);
  EXPECT_EQ(outdoor.large_scene, 300);
  const ConvexConfig light = convex_config_from_json({{"preset", "light"}, {"child_size", 0.5}});
  EXPECT_EQ(light.gradient_threshold, 2.5e-5);
  EXPECT_EQ(light.initial_sharpness, 9.5e-4);
  EXPECT_EQ(light.child_size, 0.5) << "what is said wins over the preset";
  EXPECT_EQ(light.large_scene, 0);
  EXPECT_EQ(convex_config_from_json(to_json(light)).child_size, 0.5);
}

TEST(ConvexConfigs, BadOnesAreOneClearLine) {
  testing::expect_one_clear_line([](const nlohmann::json& json) { convex_config_from_json(json); },
                                 {{R"({"presets": "indoor"})", "'presets'"},
                                  {R"({"preset": "moon"})", "indoor, outdoor or light"},
                                  {R"({"preset": 3})", "'preset'"},
                                  {R"({"sh_degree": 4})", "sh_degree"},
                                  {R"({"initial_opacity": 1})", "initial_opacity"},
                                  {R"({"initial_sharpness": 0})", "initial_sharpness"},
                                  {R"({"child_opacity": 0})", "child_opacity"},
                                  {R"({"child_opacity": 1})", "child_opacity"},
                                  {R"({"child_size": 0})", "child_size"},
                                  {R"({"reset_opacity": 0})", "reset_opacity"},
                                  {R"({"trim_interval": 0})", "intervals"},
                                  {R"({"densify_from": -1})", "densify_from"},
                                  {R"({"lambda_dssim": 2})", "lambda_dssim"},
                                  {R"({"lambda_mask": -1})", "lambda_mask"},
                                  {R"({"points_rate_final": 0})", "rates"},
                                  {R"({"opacity_rate": -0.01})", "rates"},
                                  {R"({"min_opacity": 1.5})", "min_opacity"},
                                  {R"({"densify_interval": 2147483647})", "densify_interval"},
                                  {R"({"reference_focal": -1})", "reference_focal"}});
}

TEST(ConvexShapes, BeginOnSpheresAndAreMeasuredByTheirLongestDeviation) {
  const std::vector<float> centres{1, 2, 3, -4, 0, 7}, radii{0.5f, 2};
  const std::vector<float> points = spheres(centres, radii);
  ASSERT_EQ(points.size(), 2 * kConvexWidth);
  for (std::size_t i = 0; i < 2; ++i) {
    std::set<float> heights;
    for (std::size_t k = 0; k < kConvexPoints; ++k) {
      double length = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        length += std::pow(static_cast<double>(points[kConvexWidth * i + 3 * k + c] - centres[3 * i + c]), 2);
      }
      EXPECT_NEAR(std::sqrt(length), radii[i], 1e-5);
      heights.insert(points[kConvexWidth * i + 3 * k + 2]);
    }
    EXPECT_EQ(heights.size(), 6u);
  }
  const std::vector<float> flat{0, 0, 5, 0, 0, 5, 0, 0, 5, 4, 1, 5, 4, 1, 5, 4, 1, 5};
  std::vector<float> longest(1);
  longest_deviations(flat, longest);
  EXPECT_FLOAT_EQ(longest[0], 2);
}

/// Raw parameters of visible convexes with these points [N,6,3].
ConvexCloud cloud_of(const std::vector<float>& points) {
  const std::size_t n = points.size() / kConvexWidth;
  ConvexCloud cloud;
  cloud.points = points;
  for (std::vector<float>* values :
       {&cloud.log_smoothness, &cloud.log_sharpness, &cloud.logit_opacities, &cloud.logit_masks}) {
    values->assign(n, 1.0f);
  }
  cloud.sh_dc.assign(3 * n, 0.5f);
  cloud.sh_rest.assign(45 * n, 0.0f);
  cloud.focal_lengths = {1000};
  return cloud;
}

double area_of(const TriangleMesh& mesh) {
  double area = 0;
  for (std::size_t t = 0; t < mesh.size(); ++t) {
    double edges[2][3];
    for (std::size_t k = 0; k < 2; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        edges[k][c] = static_cast<double>(mesh.positions[3 * mesh.triangles[3 * t + 1 + k] + c]) -
                      static_cast<double>(mesh.positions[3 * mesh.triangles[3 * t] + c]);
      }
    }
    const auto& [a, b] = edges;
    area += std::hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]) / 2;
  }
  return area;
}

TEST(ConvexMesh, HasNoTriangleTwiceWherePointsLieInAPlane) {
  // A hexagon of side 5, tilted; a prism of two triangles, whose sides are squares.
  std::vector<float> hexagon;
  for (int k = 0; k < 6; ++k) {
    const float x = 5 * std::cos(1.0471976f * static_cast<float>(k)),
                y = 5 * std::sin(1.0471976f * static_cast<float>(k));
    hexagon.insert(hexagon.end(), {7 + 0.8f * x, y, 3 + 0.6f * x});
  }
  const std::vector<float> prism{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 0, 1, 0, 1, 1};
  const TriangleMesh flat = convex_mesh(cloud_of(hexagon)), solid = convex_mesh(cloud_of(prism));
  EXPECT_EQ(flat.size(), 8u) << "both sides of a hexagon";
  EXPECT_NEAR(area_of(flat), 3 * std::sqrt(3.0) * 25, 1e-3);
  EXPECT_EQ(solid.size(), 8u);
  EXPECT_NEAR(area_of(solid), 3 + std::sqrt(2.0), 1e-6);
}

TEST(ConvexMesh, OfOnePointHasNoTriangles) {
  std::vector<float> points{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 0, 1, 0, 1, 1};
  points.insert(points.end(), kConvexWidth, 2.0f);
  EXPECT_EQ(convex_mesh(cloud_of(points)).size(), 8u);
  test::expect_contains(test::input_error_of([&] { convex_mesh(cloud_of(std::vector<float>(kConvexWidth, 2.0f))); }),
                        "no visible convexes");
}

TEST(ConvexEntry, IsKnownByItsName) {
  EXPECT_EQ(convex_splatting_entry().name, "convex-splatting");
  EXPECT_EQ(convex_splatting_entry().iterations, 30000);
}

}  // namespace
}  // namespace splatboost

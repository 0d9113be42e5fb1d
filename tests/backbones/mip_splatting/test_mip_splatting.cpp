// SPDX-License-Identifier: Apache-2.0
// Training Mip-Splatting: published decisions, updates of the 3D filter, gradients, resume, quality.
#include "mip_splatting/mip_splatting.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "splatboost/smoothing.h"
#include "support/density_recorder.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "trainer/dataset/smaller_view.h"
#include "trainer/evaluation/evaluate.h"
#include "trainer/training/trainer.h"
#include "vanilla/vanilla.h"

namespace splatboost {
namespace {

using testing::DensityEvent;
using testing::DensityRecorder;
using testing::exported;
using testing::view_at;

class MipSplattingRun : public ::testing::Test {
 protected:
  static constexpr int kIterations = 600;  // 1/50 of the published run

  static MipSplattingConfig eager() {
    MipSplattingConfig config;
    config.densify_interval = 10;
    config.smoothing_interval = 10;
    return config;
  }
  std::unique_ptr<Backbone> make(const MipSplattingConfig& config, int iterations = kIterations, std::size_t cap = 0) {
    return make_mip_splatting({scene_, threads_, 3, iterations, cap}, config);
  }
  std::vector<float> filters_for(const SplatCloud& cloud) {
    std::vector<float> filters(cloud.size());
    const MipSplattingConfig config;
    std::vector<Camera> cameras;
    for (const View& view : scene_.train) cameras.push_back(view.camera);
    SmoothingFilters(cameras, config.smoothing_variance, config.visibility_margin, threads_)
        .compute(cloud.means, filters);
    return filters;
  }

  Threads threads_{2};
  Scene scene_ = testing::tiny_scene(threads_);
};

TEST_F(MipSplattingRun, decides_by_the_published_rules) {
  DensityRecorder recorder;
  const auto backbone = make(eager(), kIterations, 600);  // the cap applies after the rules; it keeps the test short
  backbone->set_hooks(&recorder, nullptr);
  for (int i = 1; i <= kIterations; ++i) backbone->train_step(i, view_at(scene_, i));

  std::set<int> expected, growths, prunes;
  for (int i = 20; i < 300; i += 10) expected.insert(i);
  std::size_t by_absolute_only = 0;
  const double border = 0.01 * static_cast<double>(scene_.extent);
  for (const DensityEvent& e : recorder.events) {
    (e.growth ? growths : prunes).insert(e.iteration);
    if (!e.growth) {
      for (std::size_t i = 0; i < e.remove.size(); ++i) {
        const bool large = static_cast<double>(e.max_scales[i]) > 0.1 * static_cast<double>(scene_.extent);
        EXPECT_EQ(e.remove[i] != 0, e.opacities[i] < 0.005f || (e.iteration > 60 && large));
      }
      continue;
    }
    // Those above the threshold by the signed gradient, and as large a fraction with the highest absolute gradients.
    const std::size_t n = e.gradients.size();
    const auto moving =
        static_cast<double>(std::count_if(e.gradients.begin(), e.gradients.end(), [](float g) { return g >= 2e-4f; }));
    std::vector<float> sorted = e.gradients_abs;
    std::sort(sorted.begin(), sorted.end());
    const double place = (1 - moving / static_cast<double>(n)) * static_cast<double>(n - 1);
    const auto low = static_cast<std::size_t>(place);
    const double quantile =
        sorted[low] + (place - static_cast<double>(low)) * (sorted[std::min(low + 1, n - 1)] - sorted[low]);
    for (std::size_t i = 0; i < n; ++i) {
      if (std::abs(e.gradients_abs[i] - quantile) < 1e-6 * quantile) continue;  // float rounding of the quantile
      const bool grows = e.gradients[i] >= 2e-4f || e.gradients_abs[i] >= quantile;
      const bool small = static_cast<double>(e.max_scales[i]) <= border;
      EXPECT_EQ(e.clone[i] != 0, grows && small) << "iteration " << e.iteration << " Gaussian " << i;
      EXPECT_EQ(e.split[i] != 0, grows && !small) << "iteration " << e.iteration << " Gaussian " << i;
      by_absolute_only += grows && e.gradients[i] < 2e-4f ? 1 : 0;
      EXPECT_GE(e.gradients_abs[i], e.gradients[i] * 0.999f) << "a sum of absolutes is never below";
    }
  }
  EXPECT_EQ(growths, expected);
  EXPECT_EQ(prunes, expected);
  EXPECT_GT(by_absolute_only, 5u) << "the scene must exercise the rule";
}

TEST(Quantile, interpolates_between_neighbours) {
  EXPECT_EQ(quantile({}, 0.5), 0.0f);
  const std::vector<float> values{4, 1, 3, 2};
  EXPECT_EQ(quantile(values, 0), 1.0f);
  EXPECT_EQ(quantile(values, 1), 4.0f);
  EXPECT_FLOAT_EQ(quantile(values, 0.5), 2.5f);
  EXPECT_FLOAT_EQ(quantile(values, 0.9), 3.7f);
}

TEST_F(MipSplattingRun, filter_follows_at_its_interval_and_rests_at_the_end) {
  MipSplattingConfig config;
  config.smoothing_interval = 10;
  config.densify_until = 0;
  const auto backbone = make(config, 100);
  std::vector<float> last = exported(*backbone).filters;
  for (int i = 1; i <= 100; ++i) {
    backbone->train_step(i, view_at(scene_, i));
    const SplatCloud cloud = exported(*backbone);
    if (i % 10 == 0 && i < 90) {
      EXPECT_EQ(cloud.filters, filters_for(cloud)) << i;
      EXPECT_NE(cloud.filters, last) << i;
    } else if (i > 1) {
      EXPECT_EQ(cloud.filters, last) << i;
    }
    last = cloud.filters;
  }
}

/// Renders right after the set of Gaussians has changed, and checks that the filters are those of the new set.
class ScoresAfterGrowth : public DensityRecorder {
 public:
  void prune(const DensityStatistics& s, RasterizerHook& rasterizer, PruneDecisions& d) override {
    if (d.remove.size() != before) ++changed;
    const ScoredView scored = rasterizer.render_for_score(0);
    for (const float value : scored.color) ASSERT_TRUE(std::isfinite(value));
    check();
    DensityRecorder::prune(s, rasterizer, d);
  }
  void grow(const DensityStatistics& s, RasterizerHook& rasterizer, GrowDecisions& d) override {
    before = s.gradients.size();
    DensityRecorder::grow(s, rasterizer, d);
  }
  std::function<void()> check;
  std::size_t before = 0, changed = 0;
};

TEST_F(MipSplattingRun, filter_follows_every_change_of_the_set_before_the_next_render) {
  MipSplattingConfig config = eager();
  config.smoothing_interval = 1000000;  // no periodic update
  const auto backbone = make(config);
  ScoresAfterGrowth hook;
  hook.check = [&] {
    const SplatCloud cloud = exported(*backbone);
    EXPECT_EQ(cloud.filters, filters_for(cloud));
  };
  backbone->set_hooks(&hook, nullptr);
  for (int i = 1; i <= 100; ++i) {
    backbone->train_step(i, view_at(scene_, i));
    if (i > 10 && i % 10 == 0) hook.check();
  }
  EXPECT_GT(hook.changed, 3u);
}

TEST_F(MipSplattingRun, reset_speaks_of_what_is_drawn) {
  MipSplattingConfig config = eager();
  config.opacity_reset_interval = 3000;  // at 1/50: every 60 iterations
  config.densify_from = 14000;           // no densification before
  const auto backbone = make(config);
  testing::train(*backbone, scene_, 1, 59);
  const auto highest = [&](bool drawn) {
    const SplatCloud cloud = exported(*backbone);
    float most = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      float scales[3];
      for (std::size_t c = 0; c < 3; ++c) scales[c] = std::exp(cloud.log_scales[3 * i + c]);
      const float opacity = 1 / (1 + std::exp(-cloud.logit_opacities[i]));
      most = std::max(most, drawn ? smooth(scales, opacity, cloud.filters[i]).opacity : opacity);
    }
    return most;
  };
  EXPECT_GT(highest(true), 0.1f);
  backbone->train_step(60, view_at(scene_, 60));
  EXPECT_LE(highest(true), 0.0101f);
  EXPECT_GT(highest(false), 0.0101f) << "what the filter takes off is given back";
}

TEST_F(MipSplattingRun, gradients_pass_both_filters) {
  const auto trained = make(eager());
  for (int i = 1; i <= 50; ++i) trained->train_step(i, view_at(scene_, i));
  const SplatCloud cloud = exported(*trained);
  const View& view = scene_.train[1];
  const auto found = testing::gathered_gradients(*make({}, 10000), cloud, 1, view);

  // The rasterizer's gradients of the smoothed parameters times the derivatives of the smoothing by finite differences.
  const std::size_t n = cloud.size();
  std::vector<std::array<double, 4>> raw(n);
  std::vector<float> scales, opacities;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t c = 0; c < 3; ++c) raw[i][c] = std::exp(static_cast<double>(cloud.log_scales[3 * i + c]));
    raw[i][3] = 1 / (1 + std::exp(-static_cast<double>(cloud.logit_opacities[i])));
    const auto drawn = smooth(raw[i].data(), raw[i][3], static_cast<double>(cloud.filters[i]));
    for (const double scale : drawn.scales) scales.push_back(static_cast<float>(scale));
    opacities.push_back(static_cast<float>(drawn.opacity));
  }
  RasterOptions options;
  options.low_pass = 0.1f;
  options.compensate_opacity = true;
  const auto drawn = testing::gradients_of_view(cloud, scales, opacities, view, options, 0.8f, 0.2f, threads_);
  EXPECT_NEAR(found.loss, drawn.loss, 1e-6 * drawn.loss);
  std::vector<double> expected_scales(3 * n), expected_opacities(n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < 4; ++k) {
      const double step = 1e-6 * raw[i][k];
      std::array<double, 4> up = raw[i], down = raw[i];
      up[k] += step;
      down[k] -= step;
      const auto filter = static_cast<double>(cloud.filters[i]);
      const auto high = smooth(up.data(), up[3], filter), low = smooth(down.data(), down[3], filter);
      double slope = static_cast<double>(drawn.opacities[i]) * (high.opacity - low.opacity);
      for (std::size_t c = 0; c < 3; ++c) {
        slope += static_cast<double>(drawn.scales[3 * i + c]) * (high.scales[c] - low.scales[c]);
      }
      (k < 3 ? expected_scales[3 * i + k] : expected_opacities[i]) = slope / (2 * step);
    }
  }
  testing::expect_close(found.scales, expected_scales, 1e-4);
  testing::expect_close(found.opacities, expected_opacities, 1e-4);
  testing::expect_close(found.means, {drawn.means.begin(), drawn.means.end()}, 1e-4);
}

TEST_F(MipSplattingRun, an_empty_view_shows_the_background_of_the_scene) {
  testing::expect_background_of_the_scene(
      [&](const Scene& scene) {
        return make_mip_splatting({scene, threads_, 3, kIterations, 0}, eager());
      },
      scene_);
}

TEST_F(MipSplattingRun, resume_is_exact) {
  testing::StepsEveryThird third;
  // Before, at and after densification, and between two updates of the filter.
  testing::expect_exact_resume([&] { return make(eager(), 150); }, scene_, 90, {15, 20, 21, 44, 70, 85}, &third);
}

TEST_F(MipSplattingRun, threads_do_not_change_the_bytes) {
  testing::expect_same_bytes_for_any_threads(
      [&](const Threads& threads) {
        return make_mip_splatting({scene_, threads, 3, 120, 0}, eager());
      },
      scene_, 80);
}

TEST_F(MipSplattingRun, a_model_that_comes_back_from_its_file_draws_the_same) {
  const auto backbone = make(eager());
  testing::train(*backbone, scene_, 1, 45);
  const auto again = make(eager());
  testing::import_cloud(*again, exported(*backbone));
  std::vector<float> first(scene_.train[0].color.size()), second(first.size());
  // An import activates all degrees of spherical harmonics, so both need one.
  testing::import_cloud(*backbone, exported(*backbone));
  backbone->render(scene_.train[0].camera, 0, std::nullopt, first);
  again->render(scene_.train[0].camera, 0, std::nullopt, second);
  EXPECT_EQ(first, second);
  SplatCloud plain = exported(*backbone);
  plain.filters.clear();  // as in a model of another program
  testing::import_cloud(*again, plain);
  EXPECT_EQ(exported(*again).filters, filters_for(plain));
}

TEST_F(MipSplattingRun, reaches_a_stated_quality_and_keeps_it_at_a_smaller_scale) {
  const auto train = [&](std::unique_ptr<Backbone> backbone) {
    testing::train(*backbone, scene_, 1, 400);
    backbone->finish();
    return backbone;
  };
  Scene smaller = scene_;
  for (View& view : smaller.test) view = smaller_view(view, 4);
  const auto mip = train(make({}, 400));
  const auto vanilla = train(make_vanilla({scene_, threads_, 3, 400, 0}, {}));
  EXPECT_GT(quick_psnr(*mip, scene_, 2), 20.0);
  EXPECT_GT(quick_psnr(*mip, smaller, 2), quick_psnr(*vanilla, smaller, 2) + 1);
}

TEST_F(MipSplattingRun, the_compact_box_sees_the_compensated_opacity) {
  // A Gaussian far smaller than a pixel: the low-pass filter spreads it, compensation takes its opacity below 1/255.
  // The box must not list it, although it would by its original opacity.
  Rasterizer rasterizer(threads_);
  const Camera& camera = scene_.train[0].camera;
  const std::vector<float> means{0, 0, 0}, rotations{1, 0, 0, 0}, colors{1, 1, 1};
  const std::vector<float> specks(3, 0.001f), blobs(3, 0.3f), opacity{0.5f};
  std::vector<float> image(scene_.train[0].color.size());
  const auto entries = [&](const std::vector<float>& scales, bool compensate, float beta) {
    Gaussians gaussians;
    gaussians.count = 1;
    gaussians.means = means;
    gaussians.scales = scales;
    gaussians.rotations = rotations;
    gaussians.opacities = opacity;
    gaussians.colors = colors;
    RasterOptions options;
    options.box = BoxPolicy::ellipse;
    options.beta = beta;
    options.low_pass = 0.1f;
    options.compensate_opacity = compensate;
    RasterImages images;
    images.color = image;
    rasterizer.forward(camera, gaussians, options, images);
    return rasterizer.counts().tile_entries;
  };
  EXPECT_GT(entries(specks, false, 1), 0u);
  EXPECT_EQ(entries(specks, true, 1), 0u);
  EXPECT_EQ(entries(specks, true, 0.5f), 0u);
  EXPECT_EQ(entries(blobs, true, 1), entries(blobs, false, 1)) << "what is wide loses nothing";
}

TEST(MipSplattingConfig, broken_ones_are_told_in_one_line) {
  const auto error = [](const nlohmann::json& json) {
    return test::input_error_of([&] { mip_splatting_config_from_json(json); });
  };
  test::expect_contains(error({{"low_pas", 0.2}}), "unknown key 'low_pas'");
  test::expect_contains(error({{"low_pass", 0}}), "mip-splatting: low_pass must be above 0");
  test::expect_contains(error({{"low_pass", "wide"}}), "low_pass");
  test::expect_contains(error({{"smoothing_interval", 0}}), "smoothing_interval");
  test::expect_contains(error({{"smoothing_variance", -1}}), "smoothing_variance");
  test::expect_contains(error({{"visibility_margin", -0.1}}), "visibility_margin");
  test::expect_contains(error({{"sh_degree", 9}}), "mip-splatting: sh_degree");
  EXPECT_EQ(to_json(mip_splatting_config_from_json({{"smoothing_interval", 50}}))["smoothing_interval"], 50);
}

}  // namespace
}  // namespace splatboost

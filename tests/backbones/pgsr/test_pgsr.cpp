// SPDX-License-Identifier: Apache-2.0
// PGSR in training: its published decisions, its gradients, resume, quality.
#include "pgsr/pgsr.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "pgsr/neighbor_views.h"
#include "splatboost/activations.h"
#include "splatboost/gaussian_planes.h"
#include "splatboost/surface_depth.h"
#include "splatboost/surface_loss.h"
#include "support/density_recorder.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "trainer/backbone_api/memory_estimate.h"
#include "trainer/dataset/scene_depths.h"

namespace splatboost {
namespace {

using testing::DensityEvent;
using testing::DensityRecorder;
using testing::exported;
using testing::state_of;
using testing::view_at;

class PgsrRun : public ::testing::Test {
 protected:
  PgsrRun() { scene_ = testing::tiny_scene(threads_, 12); }  // neighbours are 30° apart

  /// All loss terms start early; neighbours may be far apart.
  static PgsrConfig eager() {
    PgsrConfig config;
    config.percent_dense = 0.02;
    config.densify_interval = 10;
    config.trim_interval = 1;
    config.surface_from = 1000;
    config.split_radius = 4;
    config.neighbor_angle = 75;
    config.neighbor_farthest = 4;
    config.max_pixel_noise = 20;
    return config;
  }
  std::unique_ptr<Backbone> make(const PgsrConfig& config, int iterations = 600, std::size_t cap = 300) {
    return make_pgsr({scene_, threads_, 3, iterations, cap}, config);
  }

  Threads threads_{2};
  Scene scene_;
};

/// Activated Gaussians of a cloud.
struct ActiveCloud {
  ActiveCloud(const SplatCloud& cloud, const Threads& threads)
      : means(cloud.means),
        rotations(cloud.rotations),
        dc(cloud.sh_dc),
        scales(cloud.log_scales.size()),
        opacities(cloud.size()) {
    exponentials(cloud.log_scales, scales, threads);
    sigmoids(cloud.logit_opacities, opacities, threads);
  }
  Gaussians view() const {
    Gaussians g;
    g.count = opacities.size();
    g.means = means;
    g.scales = scales;
    g.rotations = rotations;
    g.opacities = opacities;
    g.sh_dc = dc;
    return g;
  }
  std::vector<float> means, rotations, dc, scales, opacities;
};

/// Records the radii at each growth.
class RadiusRecorder : public DensityRecorder {
 public:
  void grow(const DensityStatistics& s, RasterizerHook& rasterizer, GrowDecisions& d) override {
    radii[s.moment.iteration] = state_of(*backbone, "pgsr.radii");
    DensityRecorder::grow(s, rasterizer, d);
  }
  const Backbone* backbone = nullptr;
  std::map<int, std::vector<float>> radii;
};

TEST_F(PgsrRun, decides_by_the_published_rules) {
  RadiusRecorder recorder;
  PgsrConfig config = eager();
  config.trim_interval = 30000;
  config.gradient_threshold = 2e-3;
  const auto backbone = make(config);
  recorder.backbone = backbone.get();
  backbone->set_hooks(&recorder, nullptr);
  testing::train(*backbone, scene_, 1, 320);
  const double border = 0.02 * static_cast<double>(scene_.extent);
  std::size_t by_absolute_only = 0, too_small_on_screen = 0, clones = 0, removed = 0;
  std::set<int> expected, growths;
  for (int i = 20; i < 300; i += 10) expected.insert(i);
  for (const DensityEvent& e : recorder.events) {
    if (!e.growth) {
      for (std::size_t i = 0; i < e.remove.size(); ++i) {
        const bool large = static_cast<double>(e.max_scales[i]) > 0.1 * static_cast<double>(scene_.extent);
        EXPECT_EQ(e.remove[i] != 0, e.opacities[i] < 0.005f || (e.iteration > 60 && large));
        removed += e.remove[i];
      }
      continue;
    }
    growths.insert(e.iteration);
    const std::vector<float>& radii = recorder.radii[e.iteration];
    ASSERT_EQ(radii.size(), e.gradients.size());
    for (std::size_t i = 0; i < radii.size(); ++i) {
      const bool large = static_cast<double>(e.max_scales[i]) > border, moves = e.gradients[i] >= 2e-3f;
      const bool blurred = e.gradients_abs[i] >= 8e-4f && radii[i] > 4;
      EXPECT_EQ(e.clone[i] != 0, moves && !large) << e.iteration << " " << i;
      EXPECT_EQ(e.split[i] != 0, large && (moves || blurred)) << e.iteration << " " << i;
      by_absolute_only += large && !moves && blurred ? 1 : 0;
      too_small_on_screen += large && !moves && e.gradients_abs[i] >= 8e-4f && radii[i] <= 4 ? 1 : 0;
      clones += e.clone[i];
    }
  }
  EXPECT_EQ(growths, expected);
  EXPECT_GT(clones, 0u) << "the scene must exercise all rules";
  EXPECT_GT(removed, 0u);
  EXPECT_GT(by_absolute_only, 0u);
  EXPECT_GT(too_small_on_screen, 0u);
}

TEST_F(PgsrRun, radii_are_the_largest_of_views_that_observe_and_begin_anew_with_growth) {
  PgsrConfig config = eager();
  config.initial_opacity = 0.9;  // so that some hide others
  const auto backbone = make(config);
  const std::size_t n = backbone->primitives();
  EXPECT_EQ(state_of(*backbone, "pgsr.radii"), std::vector<float>(n, 0.0f));
  std::vector<float> expected(n, 0.0f), of_all(n, 0.0f), of_last(n, 0.0f);
  Rasterizer drawer(threads_);
  std::vector<float> image(scene_.train[0].color.size());
  RasterImages images;
  images.color = image;
  for (int iteration = 1; iteration <= 8; ++iteration) {  // the first trim is at 9
    const View& view = view_at(scene_, iteration);
    const ActiveCloud cloud(exported(*backbone), threads_);
    drawer.forward(view.camera, cloud.view(), {}, images);
    std::vector<std::int32_t> counts(n, 0);
    drawer.count_observed(0.5f, counts);
    for (std::size_t i = 0; i < n; ++i) {
      of_last[i] = static_cast<float>(drawer.screen_radii()[i]);
      of_all[i] = std::max(of_all[i], of_last[i]);
      if (counts[i] > 0) expected[i] = std::max(expected[i], of_last[i]);
    }
    backbone->train_step(iteration, view);
  }
  EXPECT_EQ(state_of(*backbone, "pgsr.radii"), expected);
  EXPECT_NE(expected, of_all) << "the scene must exercise views that do not observe";
  EXPECT_NE(expected, of_last) << "and radii that were larger in an earlier view";
  testing::train(*backbone, scene_, 9, 19);
  EXPECT_GT(std::ranges::max(state_of(*backbone, "pgsr.radii")), 0) << "since the trim at 18";
  testing::train(*backbone, scene_, 20, 20);
  const std::vector<float> after = state_of(*backbone, "pgsr.radii");
  EXPECT_EQ(after, std::vector<float>(backbone->primitives(), 0.0f));
}

TEST_F(PgsrRun, splits_for_blur_alone_are_capped_by_their_gradient) {
  DensityRecorder recorder;
  PgsrConfig config = eager();
  config.gradient_threshold = 1e9;  // no splits by the signed gradient
  config.split_radius = 2;
  config.trim_interval = 30000;
  config.max_abs_splits = 3;
  const auto backbone = make(config);
  backbone->set_hooks(&recorder, nullptr);
  testing::train(*backbone, scene_, 1, 20);
  ASSERT_FALSE(recorder.events.empty());
  const DensityEvent& e = recorder.events.front();
  EXPECT_EQ(std::count(e.split.begin(), e.split.end(), 1), 3);
  float least = 1e9f;
  for (std::size_t i = 0; i < e.split.size(); ++i) {
    if (e.split[i] != 0) least = std::min(least, e.gradients_abs[i]);
  }
  EXPECT_GE(least, 8e-4f);
  EXPECT_EQ(std::count(e.clone.begin(), e.clone.end(), 1), 0);
}

TEST_F(PgsrRun, clones_are_scattered) {
  PgsrConfig config = eager();
  config.position_rate_initial = config.position_rate_final = 1e-30;
  config.percent_dense = 100;  // all are small: cloned, not split: cloned, not split
  const auto backbone = make(config);
  testing::train(*backbone, scene_, 1, 19);
  const std::size_t before = backbone->primitives();
  testing::train(*backbone, scene_, 20, 20);
  ASSERT_GT(backbone->primitives(), before + 3);
  const SplatCloud cloud = exported(*backbone);
  std::set<std::array<float, 3>> places;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    places.insert({cloud.means[3 * i], cloud.means[3 * i + 1], cloud.means[3 * i + 2]});
  }
  EXPECT_EQ(places.size(), cloud.size());
}

/// Compares each trim with counts of the observing views.
class TrimRecorder : public DensityRecorder {
 public:
  TrimRecorder(const Scene& scene, const Threads& threads) : scene_(scene), threads_(threads) {}
  void prune(const DensityStatistics& s, RasterizerHook& rasterizer, PruneDecisions& d) override {
    DensityRecorder::prune(s, rasterizer, d);
    if (d.rule != PruneRule::trim) return;
    const ActiveCloud cloud(exported(*backbone), threads_);
    std::vector<int> seen(d.remove.size(), 0);
    Rasterizer drawer(threads_);
    std::vector<float> image(scene_.train[0].color.size());
    RasterImages images;
    images.color = image;
    for (const View& view : scene_.train) {
      drawer.forward(view.camera, cloud.view(), {}, images);
      std::vector<std::int32_t> counts(seen.size(), 0);
      drawer.count_observed(0.5f, counts);
      for (std::size_t i = 0; i < seen.size(); ++i) seen[i] += counts[i] > 0 ? 1 : 0;
    }
    for (std::size_t i = 0; i < seen.size(); ++i) {
      EXPECT_EQ(d.remove[i] != 0, seen[i] < 2) << s.moment.iteration << " " << i;
      removed += d.remove[i];
    }
    iterations.push_back(s.moment.iteration);
  }
  const Backbone* backbone = nullptr;
  std::size_t removed = 0;
  std::vector<int> iterations;

 private:
  const Scene& scene_;
  Threads threads_;
};

TEST_F(PgsrRun, trims_what_fewer_than_two_views_observe) {
  PgsrConfig config = eager();
  config.trim_interval = 1000;  // at 1/50: every 20 iterations
  // Points above the cameras, which none of them sees.
  for (const float x : {0.0f, 0.1f, 0.2f, 0.3f}) {
    for (const float coordinate : {x, 50.0f, 0.0f}) scene_.points.positions.push_back(coordinate);
    for (int c = 0; c < 3; ++c) scene_.points.colors.push_back(128);
  }
  TrimRecorder recorder(scene_, threads_);
  const auto backbone = make(config);
  recorder.backbone = backbone.get();
  backbone->set_hooks(&recorder, nullptr);
  testing::train(*backbone, scene_, 1, 85);
  EXPECT_EQ(recorder.iterations, (std::vector<int>{20, 40, 60, 80}));
  EXPECT_GE(recorder.removed, 4u);
  config.trim_interval = 1;
  TrimRecorder often(scene_, threads_);
  const auto short_run = make(config);
  often.backbone = short_run.get();
  short_run->set_hooks(&often, nullptr);
  testing::train(*short_run, scene_, 1, 20);
  const auto views = static_cast<int>(scene_.train.size());
  EXPECT_EQ(often.iterations, (std::vector<int>{views, 2 * views})) << "not more often than views are trained on";
}

TEST_F(PgsrRun, a_trim_of_a_single_view_keeps_what_it_observes) {
  PgsrConfig config = eager();
  config.trim_interval = 1000;  // at 1/50: every 20 iterations
  scene_.train.resize(1);
  const auto backbone = make(config);
  testing::train(*backbone, scene_, 1, 25);
  EXPECT_GT(backbone->primitives(), 10u);
}

class PgsrScale : public PgsrRun, public ::testing::WithParamInterface<double> {};

TEST_P(PgsrScale, gradients_are_those_of_all_terms_in_both_views) {
  const auto trained = make(eager());
  testing::train(*trained, scene_, 1, 60);
  SplatCloud cloud = exported(*trained);
  std::ranges::fill(cloud.sh_rest, 0.0f);
  PgsrConfig config = eager();
  config.ncc_scale = GetParam();
  const bool rescaled = config.ncc_scale != 1;
  if (rescaled) scene_.train_rescaled = testing::tiny_scene(threads_, 12, 96, 80).train;
  const int iteration = 2003;  // no densification or pruning
  const View& view = scene_.train[1];
  const auto found = testing::gathered_gradients(*make(config, 30000), cloud, iteration, view);

  const double unit = typical_depth(scene_) / kPublishedDepth;
  const auto neighbors = neighbor_views(
      scene_.train,
      {config.max_neighbors, config.neighbor_angle, unit * config.neighbor_nearest, unit * config.neighbor_farthest});
  const RandomStream numbers(3, iteration, RandomPurpose::neighbor_view);
  ASSERT_GT(neighbors[1].size(), 1u);
  const std::size_t neighbor = neighbors[1][numbers.below(0, neighbors[1].size())];
  const View& other = scene_.train[neighbor];
  const ActiveCloud active(cloud, threads_);
  auto expected = testing::gradients_of_view(cloud, active.scales, active.opacities, view, {}, 0.8f, 0.2f, threads_);

  // The flatness term, over the Gaussians that the view sees.
  Rasterizer rasterizer(threads_);
  const std::size_t n = cloud.size();
  const View* views[2] = {&view, &other};
  std::vector<float> colors[2], features[2], alphas[2], planes[2], gradients[2];
  const std::size_t pixels = view.color.size() / 3;
  const auto draw = [&](std::size_t v) {
    colors[v].resize(3 * pixels);
    features[v].resize(4 * pixels);
    alphas[v].resize(pixels);
    planes[v].resize(4 * n);
    Gaussians g = active.view();
    gaussian_planes(g, views[v]->camera, planes[v], threads_);
    g.features = planes[v];
    g.features_per_gaussian = 4;
    RasterImages images;
    images.color = colors[v];
    images.features = features[v];
    images.alpha = alphas[v];
    rasterizer.forward(views[v]->camera, g, {}, images);
    return g;
  };
  draw(0);
  std::vector<double> sums(2);
  flatness_loss(active.scales, rasterizer.visible(), 100, sums, threads_);
  flatness_loss_backward(active.scales, rasterizer.visible(), 100, sums, expected.scales, threads_);
  draw(1);
  for (auto& g : gradients) g.assign(4 * pixels, 0.0f);
  SurfaceTerms terms;
  terms.max_pixel_noise = 20;
  terms.near_depth = static_cast<float>(0.1 * unit);
  SurfaceView first{view.camera, view.truth(), features[0], alphas[0], gradients[0]};
  SurfaceView second{other.camera, other.truth(), features[1], alphas[1], gradients[1]};
  const View& photo = rescaled ? scene_.train_rescaled[1] : view;
  const View& other_photo = rescaled ? scene_.train_rescaled[neighbor] : other;
  const PatchPhoto patches{photo.camera, photo.truth()}, other_patches{other_photo.camera, other_photo.truth()};
  first.patches = &patches;
  second.patches = &other_patches;
  const SurfaceLossParts parts =
      SurfaceLoss(threads_).add(first, &second, terms, RandomStream(3, iteration, RandomPurpose::patches));
  EXPECT_GT(parts.normal, 0);
  EXPECT_GT(parts.geometric, 0);
  EXPECT_GT(parts.photometric, 0);
  EXPECT_NEAR(found.loss, expected.loss + sums[0] + parts.total(), 1e-4 * found.loss);
  for (std::size_t v = 0; v < 2; ++v) {
    const Gaussians g = draw(v);
    std::vector<float> of_planes(4 * n);
    RasterImageGradients image_gradients;
    image_gradients.features = gradients[v];
    GaussianGradients out;
    out.mode = GradientMode::accumulate;
    out.means = expected.means;
    out.scales = expected.scales;
    out.rotations = expected.rotations;
    out.opacities = expected.opacities;
    out.features = of_planes;
    rasterizer.backward(g, image_gradients, out);
    gaussian_planes_backward(g, views[v]->camera, of_planes, expected.means, expected.rotations, threads_);
  }
  const auto close = [](const std::vector<float>& a, const std::vector<float>& b) {
    testing::expect_close(a, {b.begin(), b.end()}, 1e-4);
  };
  close(found.means, expected.means);
  close(found.scales, expected.scales);
  close(found.rotations, expected.rotations);
  close(found.opacities, expected.opacities);
}

INSTANTIATE_TEST_SUITE_P(Scales, PgsrScale, ::testing::Values(1.0, 0.5));

TEST_F(PgsrRun, the_memory_estimate_counts_both_views_and_the_surface_terms) {
  const auto backbone = make(eager(), 40);
  EXPECT_GE(backbone->bytes_per_pixel(), 2 * pixel_memory_bytes() + SurfaceLoss::bytes_per_pixel());
  EXPECT_GE(backbone->bytes_per_primitive(), gaussian_memory_bytes() + drawn_memory_bytes());
}

TEST_F(PgsrRun, surface_terms_begin_when_they_shall) {
  PgsrConfig config = eager();
  config.surface_from = 15000;
  PgsrConfig without = config;
  without.normal_weight = without.geometric_weight = without.photometric_weight = 0;
  config.densify_until = without.densify_until = 0;
  const auto with_terms = make(config, 40), bare = make(without, 40);
  testing::train(*with_terms, scene_, 1, 20);
  testing::train(*bare, scene_, 1, 20);
  EXPECT_EQ(testing::model_bytes(*with_terms), testing::model_bytes(*bare));
  testing::train(*with_terms, scene_, 21, 21);
  testing::train(*bare, scene_, 21, 21);
  EXPECT_NE(testing::model_bytes(*with_terms), testing::model_bytes(*bare));
}

/// Loss of the first step that has surface terms.
double first_surface_loss(Backbone& backbone, const Scene& scene, int iteration) {
  testing::train(backbone, scene, 1, iteration - 1);
  return backbone.train_step(iteration, view_at(scene, iteration));
}

class PgsrTerms : public PgsrRun {
 protected:
  /// Surface terms from iteration 21 on; no growth.
  static PgsrConfig late() {
    PgsrConfig config = eager();
    config.surface_from = 15000;
    config.densify_until = 0;
    return config;
  }
  double loss(const PgsrConfig& config) { return loss(config, scene_); }
  double loss(const PgsrConfig& config, const Scene& scene) {
    return first_surface_loss(*make_pgsr({scene, threads_, 3, 40, 300}, config), scene, 21);
  }
};

TEST_F(PgsrTerms, edges_of_the_photo_reduce_the_term_of_normals_only) {
  PgsrConfig aware = late(), blind = late();
  blind.edge_aware = false;
  EXPECT_LT(loss(aware), loss(blind));
  aware.normal_weight = blind.normal_weight = 0;
  EXPECT_EQ(loss(aware), loss(blind));
}

TEST_F(PgsrTerms, virtual_cameras_compare_depth_where_a_view_has_no_neighbour) {
  PgsrConfig alone = late();
  alone.neighbor_farthest = 0.3;
  alone.neighbor_angle = 10;
  PgsrConfig with_virtual = alone;
  with_virtual.virtual_cameras = true;
  const double without = loss(alone);
  EXPECT_GT(loss(with_virtual), without);
  with_virtual.geometric_weight = 0;  // a virtual camera has no photo
  EXPECT_EQ(loss(with_virtual), without);
}

TEST_F(PgsrTerms, distances_are_relative_to_the_scene_unless_they_shall_be_absolute) {
  Scene large = scene_;
  for (std::vector<View>* views : {&large.train, &large.test}) {
    for (View& view : *views) {
      for (int c = 0; c < 3; ++c) view.camera.camera_from_world[3][c] *= 100;
    }
  }
  for (float& x : large.points.positions) x *= 100;
  large.extent *= 100;
  const auto at = [](const Scene& scene, double nearest, double farthest) {
    return neighbor_views(scene.train, {8, 75, nearest, farthest});
  };
  const double unit = typical_depth(scene_) / kPublishedDepth;
  EXPECT_NEAR(typical_depth(large), 100 * typical_depth(scene_), 1e-3 * typical_depth(large));
  ASSERT_EQ(at(large, 100 * unit * 0.01, 100 * unit * 4), at(scene_, unit * 0.01, unit * 4));

  PgsrConfig single = late();
  single.geometric_weight = single.photometric_weight = 0;
  PgsrConfig absolute = late();
  absolute.absolute_distances = true;
  EXPECT_GT(loss(late(), large), loss(single, large)) << "neighbours are farther than 4 units, but not in proportion";
  EXPECT_EQ(loss(absolute, large), loss(single, large)) << "no neighbour is within 4 units";
  EXPECT_GT(loss(absolute), loss(single)) << "in the small scene some are";
}

TEST_F(PgsrRun, makes_gaussians_flat) {
  PgsrConfig config = eager();
  config.scaling_rate = 0.03;
  config.densify_until = 0;
  config.normal_weight = config.geometric_weight = config.photometric_weight = 0;
  const auto flat = make(config, 150);
  config.flatness_weight = 0;
  const auto round = make(config, 150);
  const auto median_flatness = [&](Backbone& backbone) {
    testing::train(backbone, scene_, 1, 150);
    const SplatCloud cloud = exported(backbone);
    std::vector<float> ratios;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const auto [low, high] =
          std::minmax({cloud.log_scales[3 * i], cloud.log_scales[3 * i + 1], cloud.log_scales[3 * i + 2]});
      ratios.push_back(std::exp(low - high));
    }
    std::sort(ratios.begin(), ratios.end());
    return ratios[ratios.size() / 2];
  };
  EXPECT_LT(median_flatness(*flat), 0.5f * median_flatness(*round));
}

TEST_F(PgsrRun, a_scored_view_is_exposed_as_it_is_trained) {
  PgsrConfig config = eager();
  config.exposure = true;
  config.exposure_from = 1;
  config.exposure_rate = 0.02;
  for (std::size_t v = 0; v < scene_.train.size(); v += 2) {  // every other photo is darker
    for (std::uint8_t& value : scene_.train[v].color) value = static_cast<std::uint8_t>(value / 2);
  }
  const auto backbone = make(config, 300);
  testing::train(*backbone, scene_, 1, 200);
  const std::vector<float> exposures = state_of(*backbone, "exposure.values");
  ASSERT_EQ(exposures.size(), 2 * scene_.train.size());
  EXPECT_LT(exposures[0], exposures[2] - 0.05f) << "the gain of a dark photo";
  for (const std::size_t v : {0u, 1u}) {
    const ScoredView scored = backbone->rasterizer_hook().render_for_score(v);
    const std::vector<float> found(scored.color.begin(), scored.color.end());
    const std::vector<float> plain = testing::picture(*backbone, scene_.train[v]);
    for (std::size_t k = 0; k < plain.size(); k += 97) {
      EXPECT_NEAR(found[k], std::exp(exposures[2 * v]) * plain[k] + exposures[2 * v + 1], 1e-5) << k;
    }
  }
}

TEST_F(PgsrRun, exposures_step_only_after_views_that_they_compensate) {
  PgsrConfig config = eager();
  config.exposure = true;
  config.exposure_from = 1;
  const RandomStream random(7, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  for (View& view : scene_.train) {  // no render resembles noise
    for (std::uint8_t& value : view.color) value = static_cast<std::uint8_t>(255 * random.uniform(next++));
  }
  const auto backbone = make(config);
  testing::train(*backbone, scene_, 1, 20);
  const test::TemporaryFolder folder;
  testing::save_state(*backbone, folder / "state");
  EXPECT_EQ(ArchiveReader(folder / "state").integer("exposure.steps"), 0);
}

TEST_F(PgsrRun, an_empty_view_shows_the_background_of_the_scene) {
  testing::expect_background_of_the_scene(
      [&](const Scene& scene) {
        return make_pgsr({scene, threads_, 3, 600, 300}, eager());
      },
      scene_);
}

TEST_F(PgsrRun, resume_is_exact) {
  testing::StepsEveryThird third;
  PgsrConfig config = eager();
  config.exposure = config.virtual_cameras = true;
  config.exposure_from = 1000;
  // Before and after densification and a trim, with all loss terms.
  testing::expect_exact_resume([&] { return make(config, 150); }, scene_, 60, {4, 10, 15, 31}, &third);
}

TEST_F(PgsrRun, threads_do_not_change_the_bytes) {
  testing::expect_same_bytes_for_any_threads(
      [&](const Threads& threads) {
        return make_pgsr({scene_, threads, 3, 120, 0}, eager());
      },
      scene_, 50);
}

TEST_F(PgsrRun, a_model_that_comes_back_from_its_files_draws_the_same_also_with_other_views) {
  PgsrConfig config = eager();
  config.exposure = true;
  const auto backbone = make(config);
  testing::train(*backbone, scene_, 1, 45);
  const test::TemporaryFolder folder;
  backbone->export_model(folder.path());
  const auto again = make(config);
  again->import_model(folder.path());
  EXPECT_EQ(testing::model_bytes(*again), testing::model_bytes(*backbone));
  Scene fewer = scene_;
  fewer.train.resize(2);
  const auto shown = make_pgsr({fewer, threads_, 3, 120, 0}, config);
  shown->import_model(folder.path());
  backbone->import_model(folder.path());
  const std::vector<float> picture = testing::picture(*backbone, scene_.train[0]);
  EXPECT_EQ(testing::picture(*again, scene_.train[0]), picture);
  EXPECT_EQ(testing::picture(*shown, scene_.train[0]), picture);
}

TEST_F(PgsrRun, surfaces_are_those_of_its_planes) {
  const auto backbone = make(eager());
  testing::train(*backbone, scene_, 1, 45);
  ASSERT_TRUE(backbone->has_surfaces());
  const test::TemporaryFolder folder;
  backbone->export_model(folder.path());
  backbone->import_model(folder.path());
  const Camera& camera = scene_.test[0].camera;
  const std::size_t pixels = scene_.test[0].color.size() / 3;
  std::vector<float> color(3 * pixels), depth(pixels), alpha(pixels);
  backbone->render_surface(camera, 0, std::nullopt, {color, depth, alpha});
  EXPECT_EQ(color, testing::picture(*backbone, scene_.test[0]));
  const SplatCloud cloud = exported(*backbone);
  const ActiveCloud active(cloud, threads_);
  Gaussians g = active.view();
  std::vector<float> planes(4 * g.count), blended(4 * pixels), expected(pixels), expected_alpha(pixels);
  gaussian_planes(g, camera, planes, threads_);
  g.features = planes;
  g.features_per_gaussian = 4;
  RasterImages images;
  images.color = color;
  images.features = blended;
  images.alpha = expected_alpha;
  Rasterizer rasterizer(threads_);
  rasterizer.forward(camera, g, {}, images);
  plane_depth(camera, blended, expected, threads_);
  EXPECT_EQ(depth, expected);
  EXPECT_EQ(alpha, expected_alpha);
  EXPECT_GT(*std::max_element(depth.begin(), depth.end()), 1);
}

TEST_F(PgsrRun, reaches_a_stated_quality_and_holds_the_cap) {
  PgsrConfig config;
  config.max_gaussians = 150;
  const auto backbone = make(config, 400, 0);
  testing::train(*backbone, scene_, 1, 400);
  backbone->finish();
  EXPECT_GT(quick_psnr(*backbone, scene_, 3), 20.0);
  EXPECT_LE(backbone->primitives(), 150u);
}

TEST(PgsrConfig, broken_ones_are_told_in_one_line) {
  testing::expect_one_clear_line([](const nlohmann::json& json) { pgsr_config_from_json(json); },
                                 {{R"({"trim_view": 2})", "unknown key 'trim_view'"},
                                  {R"({"trim_interval": 0})", "pgsr: trim_interval"},
                                  {R"({"observe_transmittance": 1})", "observe_transmittance"},
                                  {R"({"neighbor_farthest": 0})", "neighbor_farthest"},
                                  {R"({"neighbor_angle": 0})", "neighbor_angle"},
                                  {R"({"max_pixel_noise": 0})", "max_pixel_noise"},
                                  {R"({"photometric_weight": -1})", "photometric_weight"},
                                  {R"({"ncc_scale": 0})", "ncc_scale"},
                                  {R"({"exposure": 3})", "exposure"},
                                  {R"({"sh_degree": 9})", "pgsr: sh_degree"}});
  EXPECT_EQ(to_json(pgsr_config_from_json({{"max_neighbors", 3}}))["max_neighbors"], 3);
  EXPECT_EQ(to_json(PgsrConfig{})["percent_dense"], 0.001);
}

}  // namespace
}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
// The baseline is the published one: levels, anchors used by a view, and every growth of a run are compared with direct
// implementations of the rules of Octree-GS (Ren et al. 2024, and its release). And the contract of every backbone:
// quality on a tiny scene, exact resume, models that can be read back, one-line errors for invalid settings.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "octree_gs/octree_gs.h"
#include "octree_gs/octree_levels.h"
#include "support/anchor_model.h"
#include "support/tiny_scene.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

using testing::exported;
using testing::model_bytes;
using testing::train;

constexpr std::uint64_t kSeed = 3;
constexpr int kIterations = 800;  // 1/50 of the published run
constexpr std::size_t kSlots = 3;
constexpr std::size_t kFeatures = 8;

/// Cameras near and far, so that levels differ from view to view.
Scene deep_scene(const Threads& threads) {
  Scene scene = testing::tiny_scene(threads);
  for (std::size_t i = 0; i < scene.train.size(); i += 2) {
    glm::mat4& pose = scene.train[i].camera.camera_from_world;
    pose[3][2] *= 0.55f;
  }
  return scene;
}

OctreeConfig small() {
  OctreeConfig config;
  config.feat_dim = kFeatures;
  config.n_offsets = kSlots;
  config.levels = 4;
  config.base_layer = 3;
  config.grow_interval = 10;
  config.gradient_threshold = 2e-4;
  config.success_threshold = 0;  // every slot ever drawn is judged: the test need not count views
  config.min_opacity = 0;        // no anchor is pruned
  return config;
}

TEST(OctreeLevels, distances_ask_for_levels) {
  EXPECT_FLOAT_EQ(level_at(4, 8, 2), 1);
  EXPECT_FLOAT_EQ(level_at(8, 8, 2), 0);
  EXPECT_FLOAT_EQ(level_at(1, 81, 3), 4);
  EXPECT_EQ(whole_level(1.6f, LevelRounding::round, 5), 2);
  EXPECT_EQ(whole_level(1.6f, LevelRounding::floor, 5), 1);
  EXPECT_EQ(whole_level(1.2f, LevelRounding::ceil, 5), 2);
  EXPECT_EQ(whole_level(9, LevelRounding::round, 5), 5);
  EXPECT_EQ(whole_level(-3, LevelRounding::round, 5), 0);
}

TEST(OctreeLevels, the_scene_says_how_many_there_are) {
  // Points at distances 1 to 16 from the only camera, at the origin: log2(16 / 1) + 1 levels.
  View view;
  view.camera.width = view.camera.height = 16;
  std::vector<float> points;
  for (int i = 0; i <= 150; ++i) points.insert(points.end(), {1 + 0.1f * static_cast<float>(i), 0, 0});
  const LevelRange range = measure_levels(points, {view}, 1.0, 2);
  EXPECT_FLOAT_EQ(range.standard_distance, 16);
  EXPECT_EQ(range.levels, 5);
  // The view's 10 % and 90 % quantiles are 2.5 and 14.5; those of these two are 3.7 and 13.3: log2(3.6) rounds to 2.
  EXPECT_NEAR(measure_levels(points, {view}, 0.9, 2).standard_distance, 13.3f, 0.01f);
  EXPECT_EQ(measure_levels(points, {view}, 0.9, 2).levels, 3);
}

TEST(OctreeLevels, later_levels_open_after_shorter_intervals_and_the_last_in_time) {
  const std::vector<double> at = opening_iterations(3, 190, 1.5);
  ASSERT_EQ(at.size(), 3u);
  EXPECT_NEAR(at[0], 90, 1e-9);
  EXPECT_NEAR(at[1], 150, 1e-9);
  EXPECT_NEAR(at[2], 190, 1e-9);
  EXPECT_TRUE(opening_iterations(0, 100, 1.5).empty());
  EXPECT_TRUE(opening_iterations(-1, 100, 1.5).empty());
}

class OctreeTrace : public ::testing::Test {
 protected:
  Threads threads_{2};
  Scene scene_ = deep_scene(threads_);

  /// Share of the training cameras that use an anchor of this level at this place.
  double share(const float* p, int level, double standard) const {
    int uses = 0;
    for (const View& view : scene_.train) {
      const glm::vec3 d = glm::vec3(p[0], p[1], p[2]) - view.camera.centre();
      const long wanted = std::lrint(std::log2(standard / std::hypot(d.x, d.y, d.z)));
      uses += level <= std::clamp(wanted, 0L, 3L) ? 1 : 0;
    }
    return uses / static_cast<double>(scene_.train.size());
  }
};

/// Constants of the octree in the model files.
struct Constants {
  float voxel_size, standard_distance, origin;
};
Constants constants_of(const Backbone& backbone) {
  const test::TemporaryFolder folder;
  backbone.export_model(folder.path());
  const ArchiveReader nets(folder / "nets.bin");
  return {nets.floats("voxel_size")[0], nets.floats("standard_dist")[0], nets.floats("init_pos")[0]};
}

TEST_F(OctreeTrace, every_level_starts_with_the_cells_that_hold_points_and_that_a_camera_uses) {
  const auto backbone = make_octree({scene_, threads_, kSeed, kIterations, 0}, small());
  const Constants c = constants_of(*backbone);
  const std::vector<float>& points = scene_.points.positions;
  const auto [low, high] = std::minmax_element(points.begin(), points.end());
  EXPECT_FLOAT_EQ(c.origin, 1.1f * *low);
  EXPECT_FLOAT_EQ(c.voxel_size, (1.1f * *high - 1.1f * *low) / 8);
  std::set<std::array<float, 4>> expected, found;
  for (int level = 0; level < 4; ++level) {
    const float size = c.voxel_size / static_cast<float>(1 << level);
    for (std::size_t i = 0; i < points.size(); i += 3) {
      std::array<float, 4> a{};
      for (std::size_t k = 0; k < 3; ++k) {
        a[k] = c.origin + size * static_cast<float>(std::lrint((points[i + k] - c.origin) / size));
      }
      a[3] = static_cast<float>(level);
      if (share(a.data(), level, c.standard_distance) > 0) expected.insert(a);
    }
  }
  const std::vector<float> rows = exported(*backbone, {"x", "y", "z", "level"});
  for (std::size_t i = 0; i < rows.size(); i += 4) found.insert({rows[i], rows[i + 1], rows[i + 2], rows[i + 3]});
  EXPECT_EQ(found, expected);
  EXPECT_EQ(backbone->primitives(), expected.size());
}

TEST_F(OctreeTrace, a_negative_threshold_is_the_mean_share_of_all_cells) {
  OctreeConfig config = small();
  const auto all = make_octree({scene_, threads_, kSeed, kIterations, 0}, config);
  const Constants c = constants_of(*all);
  std::map<std::array<float, 4>, double> shares;
  double sum = 0;
  for (int level = 0; level < 4; ++level) {
    const float size = c.voxel_size / static_cast<float>(1 << level);
    for (std::size_t i = 0; i < scene_.points.positions.size(); i += 3) {
      std::array<float, 4> a{};
      for (std::size_t k = 0; k < 3; ++k) {
        a[k] = c.origin + size * static_cast<float>(std::lrint((scene_.points.positions[i + k] - c.origin) / size));
      }
      a[3] = static_cast<float>(level);
      if (shares.emplace(a, share(a.data(), level, c.standard_distance)).second) sum += shares[a];
    }
  }
  const double mean = sum / static_cast<double>(shares.size());
  EXPECT_TRUE(std::ranges::any_of(shares, [](const auto& cell) { return cell.second == 0; }));
  const auto expected = std::ranges::count_if(shares, [&](const auto& cell) { return cell.second > mean; });
  config.visible_threshold = -1;
  const auto kept = make_octree({scene_, threads_, kSeed, kIterations, 0}, config);
  EXPECT_EQ(kept->primitives(), static_cast<std::size_t>(expected));
}

/// Records the backbone's decisions and its model at that moment; changes nothing.
class Recorder : public DensityHook {
 public:
  struct Event {
    int iteration;
    std::vector<float> gradients, positions, features, anchors, levels, extra_levels, seen;
    std::vector<std::uint8_t> clone;
  };
  void grow(const DensityStatistics& s, RasterizerHook&, GrowDecisions& d) override {
    Event e;
    e.iteration = s.moment.iteration;
    e.gradients.assign(s.gradients.begin(), s.gradients.end());
    e.clone.assign(d.clone.begin(), d.clone.end());
    e.positions = testing::slot_positions(*backbone, kSlots);
    e.features = exported(*backbone, "f_anchor_feat_", kFeatures);
    e.anchors = exported(*backbone, {"x", "y", "z"});
    e.levels = exported(*backbone, {"level"});
    e.extra_levels = exported(*backbone, {"extra_level"});
    const test::TemporaryFolder folder;
    ArchiveWriter archive;
    backbone->save(archive);
    archive.write(folder / "state");
    e.seen = ArchiveReader(folder / "state").floats("statistics.slot_seen");
    events.push_back(e);
  }
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions&) override { FAIL() << "pruning is by anchor"; }
  const Backbone* backbone = nullptr;
  std::vector<Event> events;
};

TEST_F(OctreeTrace, grows_when_where_and_how_the_published_rules_say) {
  const OctreeConfig config = small();
  const auto backbone = make_octree({scene_, threads_, kSeed, kIterations, 0}, config);
  const Constants c = constants_of(*backbone);
  Recorder recorder;
  recorder.backbone = backbone.get();
  backbone->set_hooks(&recorder, nullptr);
  std::set<int> expected_at, at;
  std::size_t same_level = 0, finer_level = 0;
  std::vector<float> extra_before(backbone->primitives(), 0.0f);
  const double u = std::pow(2.0, 0.2);
  for (int i = 1; i <= 560; ++i) {
    if (i > 30 && i < 500 && i % 10 == 0) expected_at.insert(i);  // iterations 1500 to 25 000 of 40 000
    const std::size_t events = recorder.events.size();
    train(*backbone, scene_, i, i);
    if (recorder.events.size() == events) continue;
    const Recorder::Event& e = recorder.events.back();
    at.insert(i);
    const std::size_t n = e.levels.size();
    std::set<std::array<float, 5>> expected, found;  // position, level, largest feature
    std::vector<std::set<std::array<long, 3>>> taken(4);
    const auto cell_of = [&](const float* p, int level) {
      const float size = c.voxel_size / static_cast<float>(1 << level);
      std::array<long, 3> cell{};
      for (std::size_t k = 0; k < 3; ++k) cell[k] = std::lrint((p[k] - c.origin) / size);
      return cell;
    };
    for (std::size_t a = 0; a < n; ++a) {
      taken[static_cast<std::size_t>(e.levels[a])].insert(cell_of(&e.anchors[3 * a], static_cast<int>(e.levels[a])));
    }
    for (int level = 0; level < 4; ++level) {
      const double own = config.gradient_threshold * std::pow(u, level);
      for (const bool finer : {false, true}) {
        const int to = level + (finer ? 1 : 0);
        if (to > 3 || taken[static_cast<std::size_t>(to)].empty()) continue;
        std::map<std::array<long, 3>, float> added;
        for (std::size_t s = 0; s < n * kSlots; ++s) {
          if (static_cast<int>(e.levels[s / kSlots]) != level) continue;
          const float g = e.gradients[s];
          const bool wants = finer ? g >= static_cast<float>(own * u)
                                   : g >= static_cast<float>(own) && g < static_cast<float>(own * u);
          if (!wants) continue;
          const auto cell = cell_of(&e.positions[3 * s], to);
          if (taken[static_cast<std::size_t>(to)].contains(cell)) continue;
          const float* feature = &e.features[kFeatures * (s / kSlots)];
          float largest = finer ? 0.0f : *std::max_element(feature, feature + kFeatures);
          const auto [place, is_new] = added.try_emplace(cell, largest);
          if (!is_new) place->second = std::max(place->second, largest);
        }
        const float size = c.voxel_size / static_cast<float>(1 << to);
        for (const auto& [cell, feature] : added) {
          std::array<float, 5> row{};
          for (std::size_t k = 0; k < 3; ++k) row[k] = c.origin + size * static_cast<float>(cell[k]);
          if (share(row.data(), to, c.standard_distance) <= 0) continue;  // no camera would use it
          row[3] = static_cast<float>(to);
          row[4] = feature;
          expected.insert(row);
          taken[static_cast<std::size_t>(to)].insert(cell);
          (finer ? finer_level : same_level) += 1;
        }
      }
    }
    const std::vector<float> rows = exported(*backbone, {"x", "y", "z", "level"});
    const std::vector<float> features = exported(*backbone, "f_anchor_feat_", kFeatures);
    for (std::size_t a = n; a < rows.size() / 4; ++a) {
      const float* f = &features[kFeatures * a];
      found.insert(
          {rows[4 * a], rows[4 * a + 1], rows[4 * a + 2], rows[4 * a + 3], *std::max_element(f, f + kFeatures)});
    }
    EXPECT_EQ(found, expected) << "iteration " << i;
    ASSERT_EQ(rows.size() / 4, n + expected.size());

    // An anchor's extra level rises by 0.01 for each level whose threshold its mean gradient reaches.
    for (std::size_t a = 0; a < n; ++a) {
      float sum = 0;
      int seen = 0;
      for (std::size_t s = kSlots * a; s < kSlots * (a + 1); ++s) {
        sum += e.gradients[s];
        seen += e.seen[s] > 0 ? 1 : 0;
      }
      float extra = extra_before[a];
      for (int level = 0; level < 4; ++level) {
        if (std::count(e.levels.begin(), e.levels.end(), static_cast<float>(level)) == 0) continue;
        const double from = 0.25 * config.gradient_threshold * std::pow(u, level);
        if (sum / (static_cast<float>(seen) + 1e-6f) >= static_cast<float>(from)) extra += 0.01f;
      }
      EXPECT_FLOAT_EQ(e.extra_levels[a], extra);
    }
    extra_before = exported(*backbone, {"extra_level"});
    for (std::size_t a = n; a < extra_before.size(); ++a) EXPECT_EQ(extra_before[a], 0.0f);
  }
  EXPECT_EQ(at, expected_at);
  EXPECT_GT(same_level, 5u) << "the scene must exercise both rules";
  EXPECT_GT(finer_level, 20u);
}

TEST_F(OctreeTrace, a_closed_gate_grows_nothing_but_leaves_the_levels_of_views_alone) {
  testing::ClosedGate closed;
  std::vector<float> extra[2];
  std::size_t start = 0;
  for (const bool gated : {false, true}) {
    const auto backbone = make_octree({scene_, threads_, kSeed, kIterations, 0}, small());
    start = backbone->primitives();
    if (gated) backbone->set_hooks(&closed, nullptr);
    train(*backbone, scene_, 1, 40);
    EXPECT_EQ(backbone->primitives() == start, gated);
    extra[gated] = exported(*backbone, {"extra_level"});
    extra[gated].resize(start);
  }
  EXPECT_EQ(extra[0], extra[1]);
  EXPECT_GT(*std::max_element(extra[0].begin(), extra[0].end()), 0);
}

TEST_F(OctreeTrace, finer_levels_open_as_training_goes_on) {
  // A scored view draws only slots of anchors of open levels.
  OctreeConfig config = small();
  config.gradient_threshold = 1e9;
  const auto backbone = make_octree({scene_, threads_, kSeed, kIterations, 0}, config);
  const std::vector<float> levels = exported(*backbone, {"level"});
  const auto finest_drawn = [&] {
    RasterizerHook& hook = backbone->rasterizer_hook();
    int finest = -1;
    for (std::size_t v = 0; v < hook.scorable_views(); ++v) {
      const ScoredView view = hook.render_for_score(v);
      const std::vector<std::uint8_t> all(view.color.size() / 3, 1);
      std::vector<std::int32_t> counts(hook.primitives(), 0);
      hook.count_flagged(all, counts);
      for (std::size_t s = 0; s < counts.size(); ++s) {
        if (counts[s] > 0) finest = std::max(finest, static_cast<int>(levels[s / kSlots]));
      }
    }
    return finest;
  };
  const int everything = *std::max_element(levels.begin(), levels.end()) > 2 ? 3 : 2;
  config.init_level = 0;
  const auto from_zero = make_octree({scene_, threads_, kSeed, kIterations, 0}, config);
  train(*backbone, scene_, 1, 1);
  EXPECT_EQ(finest_drawn(), std::min(2, everything)) << "half of the levels at first";
  train(*backbone, scene_, 2, 201);  // all levels are open after iteration 10 000 of 40 000
  EXPECT_EQ(finest_drawn(), everything);
}

TEST(OctreeTraining, reaches_a_stated_quality_on_a_tiny_scene) {
  Threads threads(2);
  const Scene scene = testing::tiny_scene(threads);
  OctreeConfig config;
  config.levels = 3;
  config.base_layer = 4;
  config.grow_interval = 20;
  const auto backbone = make_octree({scene, threads, 0, 500, 0}, config);
  train(*backbone, scene, 1, 500);
  backbone->finish();
  EXPECT_GT(testing::mean_psnr(*backbone, scene.train), 30);
}

OctreeConfig everything() {
  OctreeConfig config = small();
  config.appearance_dim = 3;
  config.use_feat_bank = true;
  config.add_level = true;
  config.add_cov_dist = true;
  return config;
}

TEST(OctreeTraining, resuming_gives_the_bytes_of_an_uninterrupted_run) {
  Threads threads(2);
  const Scene scene = deep_scene(threads);
  testing::expect_exact_resume(
      [&] {
        return make_octree({scene, threads, kSeed, kIterations, 0}, everything());
      },
      scene, 80, {45});
}

TEST(OctreeTraining, gives_the_same_bytes_for_any_number_of_threads) {
  Threads threads(1);
  const Scene scene = deep_scene(threads);
  testing::expect_same_bytes_for_any_threads(
      [&](const Threads& any) {
        return make_octree({scene, any, kSeed, kIterations, 0}, everything());
      },
      scene, 60);
}

TEST(OctreeTraining, a_model_can_be_read_back_also_with_other_views) {
  Threads threads(2);
  const Scene scene = deep_scene(threads);
  const auto trained = make_octree({scene, threads, kSeed, 60, 0}, everything());
  train(*trained, scene, 1, 60);
  const test::TemporaryFolder folder;
  trained->export_model(folder.path());
  Scene other = scene;  // from which other levels would be derived
  other.train.resize(1);
  const auto shown = make_octree({other, threads, 0, 60, 0}, everything());
  shown->import_model(folder.path());
  EXPECT_EQ(shown->primitives(), trained->primitives());
  EXPECT_EQ(testing::picture(*shown, scene.test[0]), testing::picture(*trained, scene.test[0]));
}

TEST(OctreeTraining, an_empty_view_shows_the_background_of_the_scene) {
  Threads threads(1);
  testing::expect_background_of_the_scene(
      [&](const Scene& scene) {
        return make_octree({scene, threads, kSeed, kIterations, 0}, small());
      },
      deep_scene(threads));
}

TEST(OctreeConfig, broken_settings_give_one_clear_line) {
  testing::expect_one_clear_line(octree_config_from_json, {{R"({"fork": 1})", "fork"},
                                                           {R"({"dist2level": "progressive"})", "dist2level"},
                                                           {R"({"dist2level": 2})", "dist2level"},
                                                           {R"({"dist_ratio": 0.4})", "dist_ratio"},
                                                           {R"({"levels": 0})", "levels"},
                                                           {R"({"visible_threshold": 1})", "visible_threshold"},
                                                           {R"({"coarse_factor": 1})", "coarse_factor"},
                                                           {R"({"voxel_size": 1})", "voxel_size"},
                                                           {R"({"n_offsets": 99})", "n_offsets"}});
  EXPECT_EQ(to_json(octree_config_from_json(to_json(everything()))), to_json(everything()));
}

}  // namespace
}  // namespace splatboost

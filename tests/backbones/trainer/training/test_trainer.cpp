// SPDX-License-Identifier: Apache-2.0
#include "trainer/evaluation/evaluate.h"
#include "trainer/training/trainer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <functional>
#include <numeric>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "support/temporary_folder.h"
#include "trainer/dataset/smaller_view.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/text.h"
#include "trainer/training/data_identity.h"

namespace splatboost::test {
namespace {

/// A fake model that is the sum of the views it was trained on, and records its calls.
class FakeBackbone final : public Backbone {
 public:
  explicit FakeBackbone(const Scene& scene) : scene_(scene) {}

  double train_step(int iteration, const View& view) override {
    EXPECT_FALSE(finished);
    iterations.push_back(iteration);
    const bool half = view.camera.width < scene_.train[0].camera.width;
    const auto index = static_cast<std::size_t>(&view - (half ? scene_.train_halves : scene_.train).data());
    seen.push_back(index);
    halves_seen += half ? 1 : 0;
    EXPECT_EQ(half, halves_seen == iteration) << "halves come first";
    sum_ = sum_ * 31 + static_cast<std::uint32_t>(index) + 1;
    if (on_step) on_step(iteration);
    clock_.lap("step");
    return iteration == broken_at ? std::nan("") : 1.0 / iteration;
  }
  void finish() override { finished = true; }
  std::size_t primitives() const override { return 7; }
  void render(const Camera&, float, std::optional<float> beta, std::span<float> color) override {
    std::fill(color.begin(), color.end(), beta ? 0.0f : 0.5f);
  }
  std::uint64_t export_model(const std::filesystem::path& path) const override {
    if (full_disk) throw std::runtime_error("No space left on device");
    const std::string text = std::to_string(sum_);
    write_text_atomically(path / "model.txt", text);
    return text.size();
  }
  void import_model(const std::filesystem::path&) override {}
  void save(ArchiveWriter& archive) const override {
    if (no_checkpoint) throw std::runtime_error("File too large");
    archive.put("sum", std::int64_t{sum_});
  }
  void load(ArchiveReader& archive) override { sum_ = static_cast<std::uint32_t>(archive.integer("sum")); }
  nlohmann::json config() const override { return {}; }
  RasterizerHook& rasterizer_hook() override { std::abort(); }
  void set_hooks(DensityHook*, OptimizerHook*) override {}
  const StageClock& stages() const override { return clock_; }

  std::vector<int> iterations;
  std::vector<std::size_t> seen;
  int halves_seen = 0;
  bool finished = false;
  int broken_at = 0;
  bool full_disk = false;
  bool no_checkpoint = false;
  std::function<void(int)> on_step;

 private:
  const Scene& scene_;
  std::uint32_t sum_ = 0;
  StageClock clock_;
};

View make_view(const std::string& name) {
  View view;
  view.name = name;
  view.camera.width = 20;
  view.camera.height = 15;
  view.camera.fx = view.camera.fy = 20;
  view.color.assign(3 * 20 * 15, 255);
  return view;
}

class Trainer : public ::testing::Test {
 protected:
  Trainer() {
    for (const char* name : {"a.png", "b.png", "c.png"}) scene.train.push_back(make_view(name));
    scene.test.push_back(make_view("t.png"));
    options.iterations = 20;
    options.seed = 5;
    options.quiet = true;
    options.model = folder / "model";
  }
  std::string model(int iteration) {
    return read_file(options.model / "point_cloud" / ("iteration_" + std::to_string(iteration)) / "model.txt");
  }

  TemporaryFolder folder;
  Scene scene;
  TrainOptions options;
};

TEST(ViewOfIteration, EveryEpochSeesEachViewOnceInAnOrderOfItsOwn) {
  constexpr std::size_t kViews = 17;
  std::set<std::vector<std::size_t>> orders;
  for (int epoch = 0; epoch < 20; ++epoch) {
    std::vector<std::size_t> order;
    for (int i = 0; i < static_cast<int>(kViews); ++i) {
      order.push_back(view_of_iteration(epoch * static_cast<int>(kViews) + i + 1, kViews, 3));
    }
    orders.insert(order);
    std::sort(order.begin(), order.end());
    std::vector<std::size_t> all(kViews);
    std::iota(all.begin(), all.end(), std::size_t{0});
    EXPECT_EQ(order, all);
  }
  EXPECT_EQ(orders.size(), 20u);
  EXPECT_EQ(view_of_iteration(5, 1, 3), 0u);
}

TEST_F(Trainer, ShowsTheViewsOfTheIterationsAndEndsWithTheModel) {
  FakeBackbone backbone(scene);
  const TrainOutcome outcome = train(backbone, scene, options);
  ASSERT_EQ(backbone.seen.size(), 20u);
  for (int i = 1; i <= 20; ++i) {
    EXPECT_EQ(backbone.iterations[static_cast<std::size_t>(i - 1)], i);
    EXPECT_EQ(backbone.seen[static_cast<std::size_t>(i - 1)], view_of_iteration(i, 3, 5));
  }
  EXPECT_TRUE(backbone.finished);
  EXPECT_EQ(outcome.interrupted_by, 0);
  EXPECT_EQ(outcome.iteration, 20);
  EXPECT_GT(outcome.storage_bytes, 0u);
  EXPECT_EQ(outcome.stage_seconds.count("step"), 1u);
  EXPECT_FALSE(model(20).empty());
}

TEST_F(Trainer, StartsWithTheHalvesOfTheSameViews) {
  options.coarse_iterations = 8;
  FakeBackbone without(scene);
  train(without, scene, options);
  EXPECT_EQ(without.halves_seen, 0) << "this scene has none";

  for (const View& view : scene.train) scene.train_halves.push_back(smaller_view(view, 2));
  FakeBackbone backbone(scene);
  train(backbone, scene, options);
  EXPECT_EQ(backbone.halves_seen, 8);
  EXPECT_EQ(backbone.seen, without.seen);
}

TEST_F(Trainer, SamplesTheCurveEvenlyAndAtTheEnd) {
  options.iterations = 103;
  options.curve_points = 4;
  FakeBackbone backbone(scene);
  const TrainOutcome outcome = train(backbone, scene, options);
  ASSERT_EQ(outcome.curve.size(), 4u);
  EXPECT_EQ(outcome.curve[0].iteration, 25);
  EXPECT_EQ(outcome.curve[3].iteration, 103);
  EXPECT_NEAR(outcome.curve[0].psnr.value(), 10 * std::log10(1 / 0.25), 1e-6);
  EXPECT_EQ(outcome.curve[0].primitives, 7u);
  for (std::size_t i = 1; i < 4; ++i) EXPECT_GE(outcome.curve[i].seconds, outcome.curve[i - 1].seconds);
}

TEST_F(Trainer, ResumesToTheSameModelAndCurve) {
  options.checkpoint_iterations = {7, 13};
  options.save_iterations = {4};
  FakeBackbone whole(scene);
  const TrainOutcome expected = train(whole, scene, options);
  const std::string expected_model = model(20);
  EXPECT_FALSE(model(4).empty());

  FakeBackbone resumed(scene);
  options.resume = options.model / "checkpoints/iteration_13.ckpt";
  options.model = folder / "resumed";
  int starts = 0;
  options.on_start = [&](std::size_t) {
    ++starts;
    EXPECT_TRUE(resumed.iterations.empty());
  };
  const TrainOutcome outcome = train(resumed, scene, options);
  EXPECT_EQ(starts, 1);
  EXPECT_EQ(resumed.iterations.front(), 14);
  EXPECT_EQ(model(20), expected_model);
  ASSERT_EQ(outcome.curve.size(), expected.curve.size());
  for (std::size_t i = 0; i < expected.curve.size(); ++i) {
    EXPECT_EQ(outcome.curve[i].iteration, expected.curve[i].iteration);
    EXPECT_EQ(outcome.curve[i].loss, expected.curve[i].loss);
    EXPECT_EQ(outcome.curve[i].psnr, expected.curve[i].psnr);
  }
}

TEST_F(Trainer, ResumesFromTheLatestCheckpointOfTheRunInAFolder) {
  options.checkpoint_iterations = {7, 13};
  options.resume = folder / "empty";
  make_folder(options.resume);
  FakeBackbone whole(scene);
  train(whole, scene, options);
  EXPECT_EQ(whole.iterations.front(), 1) << "there is no checkpoint";
  const std::string expected_model = model(20);
  options.checkpoint_iterations = {15};
  options.resume.clear();
  options.seed = 6;
  FakeBackbone of_another_run(scene);
  train(of_another_run, scene, options);

  options.seed = 5;
  options.checkpoint_iterations.clear();
  options.resume = options.model / "checkpoints";
  FakeBackbone resumed(scene);
  train(resumed, scene, options);
  EXPECT_EQ(resumed.iterations.front(), 14);
  EXPECT_EQ(model(20), expected_model);
  const std::string whole_file = read_file(options.resume / "iteration_13.ckpt");
  write_text_atomically(options.resume / "iteration_13.ckpt", whole_file.substr(0, whole_file.size() / 2));
  FakeBackbone refused(scene);
  expect_contains(input_error_of([&] { train(refused, scene, options); }), "iteration_13.ckpt: is truncated");
}

TEST_F(Trainer, WritesACheckpointOfTheLastIterationThatEndsAtOnce) {
  options.checkpoint_iterations = {20};
  FakeBackbone whole(scene);
  const TrainOutcome expected = train(whole, scene, options);
  const std::string expected_model = model(20);
  options.resume = options.model / "checkpoints/iteration_20.ckpt";
  ASSERT_TRUE(is_file(options.resume));

  FakeBackbone resumed(scene);
  options.model = folder / "resumed";
  const TrainOutcome outcome = train(resumed, scene, options);
  EXPECT_TRUE(resumed.iterations.empty());
  EXPECT_EQ(model(20), expected_model);
  EXPECT_EQ(outcome.iteration, 20);
  EXPECT_EQ(outcome.interrupted_by, 0);
  EXPECT_EQ(outcome.seconds, expected.seconds);
  EXPECT_EQ(outcome.curve.size(), expected.curve.size());
}

TEST_F(Trainer, RefusesACheckpointOfAnotherRun) {
  options.identity = {{"backbone", "fake"}, {"beta", 0.5}};
  options.checkpoint_iterations = {7};
  FakeBackbone first(scene);
  train(first, scene, options);
  options.resume = options.model / "checkpoints/iteration_7.ckpt";
  options.on_start = [](std::size_t) { ADD_FAILURE() << "started"; };
  const auto refused = [&](const TrainOptions& changed, const Scene& with, const std::string& what) {
    FakeBackbone backbone(with);
    try {
      train(backbone, with, changed);
      ADD_FAILURE() << what;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(what), std::string::npos) << error.what();
    }
    EXPECT_TRUE(backbone.iterations.empty());
  };
  TrainOptions changed = options;
  changed.identity["beta"] = 0.7;
  refused(changed, scene, "beta = 0.5");
  changed = options;
  changed.identity["new"] = true;
  refused(changed, scene, "new = none");
  changed = options;
  changed.seed = 6;
  refused(changed, scene, "seed = 5");
  changed = options;
  changed.iterations = 21;
  refused(changed, scene, "iterations = 20");
  Scene other = scene;
  other.train.pop_back();
  refused(options, other, "training views = 3");
}

TEST_F(Trainer, RefusesACheckpointOfOtherData) {
  scene.points.positions = {1, 2, 3};
  scene.points.colors = {4, 5, 6};
  options.checkpoint_iterations = {7};
  FakeBackbone first(scene);
  train(first, scene, options);
  options.resume = options.model / "checkpoints/iteration_7.ckpt";
  options.model = folder / "other";
  options.on_start = [](std::size_t) { ADD_FAILURE() << "started"; };
  const auto refused = [&](const std::string& what, auto&& change) {
    Scene other = scene;
    change(other);
    FakeBackbone backbone(other);
    const std::string message = input_error_of([&] { train(backbone, other, options); });
    expect_contains(message, "iteration_7.ckpt");
    expect_contains(message, what);
    EXPECT_FALSE(std::filesystem::exists(options.model)) << "nothing is written before the run is accepted";
  };
  refused("different photos", [](Scene& s) { s.train[1].color[700] ^= 1; });
  refused("different photos", [](Scene& s) { s.train[2].valid.assign(20 * 15, 1); });
  refused("different cameras", [](Scene& s) { s.train[0].camera.camera_from_world[3][2] += 0.5f; });
  refused("different cameras", [](Scene& s) { s.train[2].camera.cx += 1; });
  refused("different cameras", [](Scene& s) { s.train[2].time = 0.5f; });
  refused("different test views", [](Scene& s) { s.test[0].color[700] ^= 1; });
  refused("different test views", [](Scene& s) { s.test[0].camera.fx += 1; });
  refused("training and test views", [](Scene& s) { std::swap(s.train[0], s.test[0]); });
  refused("training and test views", [](Scene& s) { s.test.clear(); });
  refused("training and test views", [](Scene& s) { s.train[0].name = "z.png"; });
  refused("different initial points", [](Scene& s) { s.points.positions[1] += 1; });
  refused("different initial points", [](Scene& s) { s.points.colors[1] += 1; });
}

TEST_F(Trainer, KnowsTheDataOfEarlierVersions) {
  nlohmann::json now = data_identity(scene), earlier = now;
  earlier.erase("test");
  EXPECT_EQ(data_difference(now, earlier), "");
  EXPECT_EQ(data_difference(earlier, now), "");
  // They stored which points they had made; this version may make others of the same photos.
  const nlohmann::json with_points = now;
  scene.lacks_points = true;
  scene.points.positions.push_back(1);
  EXPECT_EQ(data_difference(with_points, data_identity(scene)), "");
  EXPECT_TRUE(data_identity(scene).at("points").is_null());
  earlier.erase("photos");
  expect_contains(data_difference(now, earlier), "photos");
  expect_contains(data_difference(now, nlohmann::json("damaged")), "training and test views");
}

TEST_F(Trainer, SignalEndsTheIterationAndLeavesACheckpointToGoOnFrom) {
  FakeBackbone whole(scene);
  train(whole, scene, options);
  const std::string expected = model(20);
  for (const int stop : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) {
    options.model = folder / ("stopped" + std::to_string(stop));
    options.resume.clear();
    FakeBackbone backbone(scene);
    backbone.on_step = [&](int iteration) {
      if (iteration == 6) std::raise(stop);
    };
    const TrainOutcome outcome = train(backbone, scene, options);
    EXPECT_EQ(outcome.interrupted_by, stop);
    EXPECT_EQ(outcome.iteration, 6);
    EXPECT_FALSE(backbone.finished);
    EXPECT_EQ(outcome.checkpoint, options.model / "checkpoints/iteration_6.ckpt");

    FakeBackbone resumed(scene);
    options.resume = outcome.checkpoint;
    EXPECT_EQ(train(resumed, scene, options).interrupted_by, 0);
    EXPECT_EQ(model(20), expected);
  }
}

TEST_F(Trainer, SignalAtTheEndIsToldAfterTheModelWasExported) {
  for (const bool in_last_iteration : {true, false}) {
    options.model = folder / (in_last_iteration ? "in" : "after");
    FakeBackbone backbone(scene);
    if (in_last_iteration) {
      backbone.on_step = [](int iteration) {
        if (iteration == 20) std::raise(SIGINT);
      };
    } else {
      options.on_end = [](const TrainOutcome&) { std::raise(SIGINT); };
    }
    const TrainOutcome outcome = train(backbone, scene, options);
    EXPECT_EQ(outcome.interrupted_by, SIGINT);
    EXPECT_TRUE(outcome.checkpoint.empty()) << "nothing is left to resume";
    EXPECT_GT(outcome.storage_bytes, 0u);
    EXPECT_FALSE(model(20).empty());
  }
}

TEST_F(Trainer, SecondSignalKills) {
  EXPECT_EXIT(
      {
        FakeBackbone backbone(scene);
        backbone.on_step = [](int) {
          std::raise(SIGINT);
          std::raise(SIGINT);
        };
        train(backbone, scene, options);
      },
      ::testing::KilledBySignal(SIGINT), "");
}

TEST_F(Trainer, NamesTheIterationWhoseLossIsNotFinite) {
  FakeBackbone backbone(scene);
  backbone.broken_at = 11;
  try {
    train(backbone, scene, options);
    ADD_FAILURE();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("iteration 11"), std::string::npos) << error.what();
  }
}

TEST_F(Trainer, ASaveThatFailsLeavesNoFolder) {
  FakeBackbone backbone(scene);
  options.save_iterations = {10};
  backbone.on_step = [&](int iteration) { backbone.full_disk = iteration == 20; };
  EXPECT_THROW(train(backbone, scene, options), std::runtime_error);
  EXPECT_NE(model(10), "");
  EXPECT_FALSE(std::filesystem::exists(options.model / "point_cloud" / "iteration_20"));
}

TEST_F(Trainer, GoesOnAfterASaveThatFails) {
  FakeBackbone undisturbed(scene);
  EXPECT_EQ(train(undisturbed, scene, options).unsaved, "");
  const std::string expected = model(20);
  options.model = folder / "disturbed";
  options.save_iterations = {5, 10};
  options.checkpoint_iterations = {7, 8, 20};
  FakeBackbone backbone(scene);
  backbone.on_step = [&](int iteration) {
    backbone.full_disk = iteration == 5;
    backbone.no_checkpoint = iteration == 7 || iteration == 20;
  };
  ::testing::internal::CaptureStderr();
  const TrainOutcome outcome = train(backbone, scene, options);
  EXPECT_EQ(::testing::internal::GetCapturedStderr(),
            "warning: No space left on device; training goes on\nwarning: File too large; training goes on\n")
      << "at the end nothing goes on";
  EXPECT_EQ(outcome.unsaved, "No space left on device") << "the first reason";
  EXPECT_EQ(model(20), expected);
  EXPECT_NE(model(10), "");
  EXPECT_FALSE(std::filesystem::exists(options.model / "point_cloud" / "iteration_5"));
  EXPECT_EQ(files_in(options.model / "checkpoints"), 1u) << "that of iteration 8";
}

TEST_F(Trainer, TellsOfACheckpointAtTheEndThatFails) {
  FakeBackbone backbone(scene);
  backbone.no_checkpoint = true;
  options.checkpoint_iterations = {20};
  EXPECT_EQ(train(backbone, scene, options).unsaved, "File too large");
  EXPECT_NE(model(20), "");
}

TEST_F(Trainer, SignalLeavesTheModelIfTheCheckpointFails) {
  FakeBackbone backbone(scene);
  backbone.no_checkpoint = true;
  backbone.on_step = [&](int iteration) {
    if (iteration == 6) std::raise(SIGINT);
  };
  const auto message_of = [&] {
    try {
      train(backbone, scene, options);
    } catch (const std::runtime_error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const std::string message = message_of();
  expect_contains(message, "interrupted after iteration 6; File too large; the model so far is in");
  expect_contains(message, (options.model / "point_cloud/iteration_6").string());
  EXPECT_NE(model(6), "");
  EXPECT_FALSE(backbone.finished);
  backbone.full_disk = true;
  expect_contains(message_of(), "File too large; the model could not be saved: No space left");
}

TEST_F(Trainer, EvaluateMeasuresAndWritesPictures) {
  scene.test.push_back(make_view("u.png"));
  FakeBackbone backbone(scene);
  Results results;
  evaluate(backbone, scene, nullptr, folder / "renders", results);
  EXPECT_EQ(results.split, "test");
  ASSERT_EQ(results.views.size(), 2u);
  EXPECT_EQ(results.views[1].name, "u.png");
  EXPECT_NEAR(results.psnr, 10 * std::log10(1 / 0.25), 1e-6);
  EXPECT_NEAR(results.psnr_beta1, 0.0, 1e-6);
  EXPECT_FALSE(results.lpips.has_value());
  EXPECT_GT(results.fps, 0);
  EXPECT_EQ(files_in(folder / "renders"), 2u);
  scene.test.clear();
  evaluate(backbone, scene, nullptr, {}, results);
  EXPECT_EQ(results.split, "train");
  EXPECT_EQ(results.views.size(), 3u);
}

TEST(PictureNames, AreStemsUnlessTheseClash) {
  EXPECT_EQ(picture_names({make_view("x/1.png"), make_view("2.jpg")}), (std::vector<std::string>{"1", "2"}));
  EXPECT_EQ(picture_names({make_view("x/1.png"), make_view("y/1.png"), make_view("2.png")}),
            (std::vector<std::string>{"x_1.png", "y_1.png", "2"}));
}

TEST(PictureNames, AreNeverTheSame) {
  for (const std::vector<std::string>& names :
       {std::vector<std::string>{"x/a_b.png", "x_a/b.png", "y/a_b.png", "y/b.png"},
        {"x/b.png", "y/b.png", "x_b.png.jpg"},
        {"x_b.png.jpg", "x/b.png", "y/b.png"},
        {"a_2.png", "x/a.png", "x_a.png.png", "y/a.png", "a_2/a_2.png"}}) {
    std::vector<View> views;
    for (const std::string& name : names) views.push_back(make_view(name));
    const std::vector<std::string> pictures = picture_names(views);
    EXPECT_EQ(std::set<std::string>(pictures.begin(), pictures.end()).size(), names.size()) << names[0];
  }
}

TEST(PictureNames, FitIntoAFileSystem) {
  std::vector<View> views;
  for (const char last : {'a', 'b', 'c'}) views.push_back(make_view(std::string(300, 'n') + last + ".png"));
  std::string umlauts;
  for (int i = 0; i < 150; ++i) umlauts += "\u00e4";
  views.push_back(make_view(umlauts + ".png"));
  views.push_back(make_view("x" + umlauts + ".png"));
  const std::vector<std::string> pictures = picture_names(views);
  EXPECT_EQ(std::set<std::string>(pictures.begin(), pictures.end()).size(), views.size());
  for (const std::string& picture : pictures) {
    EXPECT_LE(picture.size(), 250u);
    EXPECT_TRUE(is_utf8(picture)) << picture;
  }
}

}  // namespace
}  // namespace splatboost::test

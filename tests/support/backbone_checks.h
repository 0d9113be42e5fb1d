// SPDX-License-Identifier: Apache-2.0
/// @file Checks that every backbone must pass, through its public interface: its files and its images.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "support/temporary_folder.h"
#include "trainer/backbone_api/backbone.h"
#include "trainer/support/input_error.h"

namespace splatboost::testing {

using MakeBackbone = std::function<std::unique_ptr<Backbone>()>;
/// Makes a backbone for a scene, which outlives it.
using MakeBackboneFor = std::function<std::unique_ptr<Backbone>(const Scene&)>;

inline const View& view_at(const Scene& scene, int iteration) {
  return scene.train[static_cast<std::size_t>(iteration) % scene.train.size()];
}

inline void train(Backbone& backbone, const Scene& scene, int first, int last) {
  for (int i = first; i <= last; ++i) backbone.train_step(i, view_at(scene, i));
}

/// The bytes of all files of an exported model.
inline std::string model_bytes(const Backbone& backbone) {
  const test::TemporaryFolder folder;
  backbone.export_model(folder.path());
  std::map<std::string, std::string> files;
  for (const auto& file : std::filesystem::directory_iterator(folder.path())) {
    files[file.path().filename()] = test::read_file(file.path());
  }
  std::string bytes;
  for (const auto& [name, content] : files) bytes += name + content;
  return bytes;
}

inline void save_state(const Backbone& backbone, const std::filesystem::path& file) {
  ArchiveWriter archive;
  backbone.save(archive);
  archive.write(file);
}

inline void load_state(Backbone& backbone, const std::filesystem::path& file) {
  ArchiveReader archive(file);
  backbone.load(archive);
}

/// An array of the backbone's checkpoint.
inline std::vector<float> state_of(const Backbone& backbone, const std::string& entry) {
  const test::TemporaryFolder folder;
  save_state(backbone, folder / "state");
  return ArchiveReader(folder / "state").floats(entry);
}

inline std::vector<float> picture(Backbone& backbone, const View& view) {
  std::vector<float> color(view.color.size());
  backbone.render(view.camera, 0, std::nullopt, color);
  return color;
}

/// Expects that a run that is saved and resumed gives byte-identical results to an uninterrupted one, for every cut.
/// @param cuts iterations to stop at @param optimizer hook that may accumulate gradients across the cut
inline void expect_exact_resume(const MakeBackbone& make, const Scene& scene, int iterations,
                                const std::vector<int>& cuts, OptimizerHook* optimizer = nullptr) {
  const auto made = [&] {
    std::unique_ptr<Backbone> backbone = make();
    backbone->set_hooks(nullptr, optimizer);
    return backbone;
  };
  const std::unique_ptr<Backbone> whole = made();
  train(*whole, scene, 1, iterations);
  whole->finish();
  const std::string expected = model_bytes(*whole);
  for (const int cut : cuts) {
    const test::TemporaryFolder folder;
    {
      const std::unique_ptr<Backbone> first = made();
      train(*first, scene, 1, cut);
      save_state(*first, folder / "checkpoint");
    }
    const std::unique_ptr<Backbone> second = made();
    load_state(*second, folder / "checkpoint");
    train(*second, scene, cut + 1, iterations);
    second->finish();
    EXPECT_EQ(model_bytes(*second), expected) << "cut after iteration " << cut;
  }
}

inline void expect_same_bytes_for_any_threads(const std::function<std::unique_ptr<Backbone>(const Threads&)>& make,
                                              const Scene& scene, int iterations) {
  std::string bytes[2];
  for (const int count : {1, 3}) {
    Threads threads(count);
    const std::unique_ptr<Backbone> backbone = make(threads);
    train(*backbone, scene, 1, iterations);
    bytes[count / 2] = model_bytes(*backbone);
  }
  EXPECT_EQ(bytes[0], bytes[1]);
}

/// Expects that a hook that sets the rate of one group to 0 freezes that group and no other.
inline void expect_rates_times_factor(Backbone& backbone, const Scene& scene, const std::string& still,
                                      const std::string& moving) {
  class Stills : public OptimizerHook {
   public:
    explicit Stills(std::string group) : group_(std::move(group)) {}
    bool steps_at(std::string_view, Moment) const override { return true; }
    float rate_factor(std::string_view group, Moment) const override { return group == group_ ? 0.0f : 1.0f; }

   private:
    std::string group_;
  };
  Stills hook(still);
  backbone.set_hooks(nullptr, &hook);
  const auto values = [&](const std::string& group) { return state_of(backbone, group + ".values"); };
  const std::vector<float> still_before = values(still), moving_before = values(moving);
  train(backbone, scene, 1, 3);
  EXPECT_EQ(values(still), still_before);
  EXPECT_NE(values(moving), moving_before);
}

/// Averages the parameters of each iteration from a given one on.
class AveragesFrom : public OptimizerHook {
 public:
  explicit AveragesFrom(int first) : first_(first) {}
  bool steps_at(std::string_view, Moment) const override { return true; }
  bool averages_at(Moment moment) const override { return moment.iteration >= first_; }

 private:
  int first_;
};

/// Expects that the parameters of a finished run are the means of those after its last three iterations, also if it was
/// saved and resumed between these.
inline void expect_averages_at_the_end(const MakeBackbone& make, const Scene& scene, int iterations,
                                       const std::vector<std::string>& groups) {
  AveragesFrom hook(iterations - 2);
  const std::unique_ptr<Backbone> backbone = make();
  backbone->set_hooks(nullptr, &hook);
  train(*backbone, scene, 1, iterations - 3);
  std::map<std::string, std::vector<double>> sums;
  const auto values = [&](const std::string& group) { return state_of(*backbone, group + ".values"); };
  for (int i = iterations - 2; i <= iterations; ++i) {
    train(*backbone, scene, i, i);
    for (const std::string& group : groups) {
      const std::vector<float> now = values(group);
      std::vector<double>& sum = sums[group];
      sum.resize(now.size(), 0.0);
      for (std::size_t k = 0; k < now.size(); ++k) sum[k] += static_cast<double>(now[k]);
    }
  }
  std::map<std::string, std::vector<float>> last;
  for (const std::string& group : groups) last[group] = values(group);
  backbone->finish();
  for (const std::string& group : groups) {
    const std::vector<float> found = values(group);
    ASSERT_EQ(found.size(), sums[group].size()) << group;
    EXPECT_NE(found, last[group]) << group << " has not moved";
    for (std::size_t k = 0; k < found.size(); ++k) {
      const double expected = sums[group][k] / 3;
      ASSERT_NEAR(static_cast<double>(found[k]), expected, 1e-6 * (1 + std::abs(expected))) << group << " " << k;
    }
  }
  expect_exact_resume(make, scene, iterations, {iterations - 2, iterations - 1}, &hook);
}

/// Expects that a view past all primitives is drawn, scored and trained on as the scene's background, black or white.
inline void expect_background_of_the_scene(const MakeBackboneFor& make, Scene scene) {
  View& away = scene.train[0];
  for (int c = 0; c < 4; ++c) {  // the camera turns round its y axis, so that everything is behind it
    away.camera.camera_from_world[c][0] *= -1;
    away.camera.camera_from_world[c][2] *= -1;
  }
  for (const bool white : {false, true}) {
    scene.white_background = white;
    std::ranges::fill(away.color, static_cast<std::uint8_t>(white ? 255 : 0));
    const std::unique_ptr<Backbone> backbone = make(scene);
    const std::vector<float> expected(away.color.size(), white ? 1.0f : 0.0f);
    EXPECT_EQ(picture(*backbone, away), expected) << "white: " << white;
    const ScoredView scored = backbone->rasterizer_hook().render_for_score(0);
    EXPECT_TRUE(std::ranges::equal(scored.color, expected)) << "white: " << white;
    EXPECT_NEAR(backbone->train_step(1, away), 0, 1e-6) << "the photo shows the same, white: " << white;
  }
}

/// Expects that opacities are reset at iteration `begin`, where growth begins, if and only if the background is white.
/// @param reset opacity; the backbone's own are larger until then
inline void expect_early_reset_only_on_white(const MakeBackboneFor& make, Scene scene, int begin, double reset) {
  const double limit = std::log(reset / (1 - reset));
  for (const bool white : {false, true}) {
    scene.white_background = white;
    const std::unique_ptr<Backbone> backbone = make(scene);
    const auto highest = [&] { return std::ranges::max(state_of(*backbone, "opacity.values")); };
    train(*backbone, scene, 1, begin - 1);
    EXPECT_GT(highest(), limit + 0.2) << "not yet, white: " << white;
    train(*backbone, scene, begin, begin);
    if (white) {
      EXPECT_NEAR(highest(), limit, 1e-5);
    } else {
      EXPECT_GT(highest(), limit + 0.2);
    }
  }
}

/// Expects that each of the JSON texts is refused with a one-line message that contains the word.
inline void expect_one_clear_line(const std::function<void(const nlohmann::json&)>& read,
                                  const std::map<const char*, const char*>& text_to_word) {
  for (const auto& [text, word] : text_to_word) {
    std::string message;
    try {
      read(nlohmann::json::parse(text));
    } catch (const InputError& error) {
      message = error.what();
    }
    EXPECT_NE(message.find(word), std::string::npos) << text << ": " << message;
    EXPECT_EQ(message.find('\n'), std::string::npos);
  }
}

/// A density hook that prevents all growth.
class ClosedGate : public DensityHook {
 public:
  void grow(const DensityStatistics&, RasterizerHook&, GrowDecisions& decisions) override {
    std::fill(decisions.clone.begin(), decisions.clone.end(), std::uint8_t{0});
  }
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions&) override {}
};

}  // namespace splatboost::testing

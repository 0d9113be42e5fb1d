// SPDX-License-Identifier: Apache-2.0
// Tracking and mapping together, on the beginning of a ray-traced walk: runs that end early keep their results.
#include "program/slam/slam_run.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <new>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "photo_slam/photo_slam.h"
#include "program/slam/slam_results.h"
#include "splatboost/threads.h"
#include "support/temporary_folder.h"
#include "support/walk_frames.h"
#include "trainer/images/video.h"
#include "trainer/sequence/trajectory.h"
#include "trainer/support/input_error.h"
#include "trainer/synth/synth_view.h"
#include "trainer/synth/synth_walk.h"

namespace splatboost::program {
namespace {

constexpr int kWidth = 160, kHeight = 120, kFrames = 12;

const std::vector<SequenceFrame>& walk() {
  static const std::vector<SequenceFrame> frames = testing::walk_frames(kWidth, kHeight, kFrames, 120);
  return frames;
}

/// The walk, alternately forward and backward, for `size` frames.
class Walk final : public Sequence {
 public:
  explicit Walk(std::size_t size, double focal_factor = 1) : size_(size) {
    const synthetic::Intrinsics camera(kWidth, kHeight);
    calibration_.width = kWidth;
    calibration_.height = kHeight;
    calibration_.fx = calibration_.fy = focal_factor * camera.focal;
    calibration_.cx = camera.cx - 0.5;
    calibration_.cy = camera.cy - 0.5;
    calibration_.depth_scale = 1000;
  }
  std::size_t size() const override { return size_; }
  const Calibration& calibration() const override { return calibration_; }
  bool computes_depth() const override { return stereo; }
  double time_of(std::size_t number) const override { return static_cast<double>(number) / 30; }
  std::string name_of(std::size_t number) const override {
    return name ? name(number) : std::to_string(number) + ".png";
  }
  std::optional<glm::dmat4> truth(std::size_t) const override { return std::nullopt; }
  SequenceFrame read(std::size_t number) override {
    if (before_frame) before_frame(number);
    const std::size_t way = number / (kFrames - 1), step = number % (kFrames - 1);
    SequenceFrame frame = walk()[way % 2 == 0 ? step : kFrames - 1 - step];
    frame.number = number;
    frame.time = time_of(number);
    frame.name = name_of(number);
    if (changed) changed(frame);
    return frame;
  }

  /// A camera without depth.
  void forget_depth() {
    calibration_.depth_scale = 0;
    changed = [](SequenceFrame& frame) { frame.depth.clear(); };
  }

  std::function<void(std::size_t)> before_frame;
  std::function<void(SequenceFrame&)> changed;  ///< modifies a frame
  std::function<std::string(std::size_t)> name;
  bool stereo = false;

 private:
  std::size_t size_;
  Calibration calibration_;
};

struct Mapping {
  explicit Mapping(std::size_t frames = kFrames, double focal_factor = 1) : sequence(frames, focal_factor), threads(2) {
    slam.tracker.features = 400;
    slam.initial_keyframes = 2;
    options.iterations = 20;
    options.quiet = true;
  }
  SlamOutcome run() {
    slam_run.emplace(
        sequence, slam, options,
        [&](const Scene& scene) {
          if (before_backbone) before_backbone(scene);
          PluggedBackbone plugged{
              nullptr, make_photo_slam({scene, threads, 0, *options.iterations, 0, threads}, {}), {}};
          if (optimizer != nullptr) plugged.backbone->set_hooks(nullptr, optimizer);
          return plugged;
        },
        stopped);
    return slam_run->run();
  }

  /// lines() of a sequence whose frames all lack their colour or depth, because of `problem`.
  template <class Part>
  std::string lines_without(Part SequenceFrame::*part, const char* problem) {
    sequence.changed = [=](SequenceFrame& frame) {
      (frame.*part).clear();
      frame.problem = problem;
    };
    return lines();
  }

  /// The standard error output of a run, and the message of its InputError.
  std::string lines() {
    slam.lockstep = 1;
    options.iterations = 1;
    ::testing::internal::CaptureStderr();
    try {
      outcome = run();
    } catch (const InputError& error) {
      return ::testing::internal::GetCapturedStderr() + error.what();
    }
    return ::testing::internal::GetCapturedStderr();
  }
  std::size_t count(TrackState state) const {
    return static_cast<std::size_t>(
        std::ranges::count_if(outcome.frames, [&](const TrackedFrame& f) { return f.state == state; }));
  }

  SlamOutcome outcome;
  Walk sequence;
  SlamOptions slam;
  RunOptions options;
  Threads threads;
  std::function<bool()> stopped = [] { return false; };
  std::function<void(const Scene&)> before_backbone;
  OptimizerHook* optimizer = nullptr;  ///< of the backbone
  std::optional<SlamRun> slam_run;
};

TEST(SlamRun, goes_to_its_end) {
  Mapping mapping;
  const SlamOutcome outcome = mapping.run();
  EXPECT_TRUE(outcome.complete);
  EXPECT_EQ(outcome.failure, nullptr);
  EXPECT_EQ(outcome.frames.size(), static_cast<std::size_t>(kFrames));
  EXPECT_GE(outcome.iterations, 20);
  EXPECT_EQ(mapping.slam_run->scene().train.size(), outcome.keyframe_frames.size());
}

TEST(SlamRun, curves_begin_in_the_sequence) {
  Mapping mapping;
  mapping.slam.lockstep = 2;
  const SlamOutcome outcome = mapping.run();
  ASSERT_GE(outcome.curve.size(), 2u);
  EXPECT_LE(outcome.curve.front().iteration, outcome.iterations_in_sequence);
  EXPECT_EQ(outcome.curve.back().iteration, outcome.iterations);
  EXPECT_EQ(std::ranges::adjacent_find(outcome.curve, std::ranges::greater_equal{}, &CurvePoint::iteration),
            outcome.curve.end())
      << "a point of every iteration at most once";
}

/// Tells when the mapper is in its second iteration.
class SecondIteration final : public OptimizerHook {
 public:
  bool steps_at(std::string_view, Moment moment) const override {
    if (moment.iteration >= 2) begun = true;
    return true;
  }
  mutable std::atomic<bool> begun = false;
};

TEST(SlamRun, progress_shows_the_mapper_beside_the_tracker) {
  Mapping mapping;
  mapping.options.quiet = false;
  SecondIteration second;
  mapping.optimizer = &second;
  mapping.sequence.before_frame = [&](std::size_t number) {
    while (number + 1 == kFrames && !second.begun) std::this_thread::yield();
  };
  ::testing::internal::CaptureStderr();
  mapping.run();
  const std::string lines = ::testing::internal::GetCapturedStderr();
  const std::size_t last = lines.find("frame 12/12");
  ASSERT_NE(last, std::string::npos) << lines;
  const std::string line = lines.substr(last, lines.find('\n', last) - last);
  EXPECT_NE(line.find("  iteration "), std::string::npos) << line;
  EXPECT_NE(line.find(" primitives"), std::string::npos) << line;
}

TEST(SlamRun, stops_when_it_is_told) {
  Mapping mapping;
  mapping.slam.lockstep = 3;
  int asked = 0;
  mapping.stopped = [&] { return ++asked > 12; };
  const SlamOutcome outcome = mapping.run();
  EXPECT_FALSE(outcome.complete);
  EXPECT_EQ(outcome.failure, nullptr);
  EXPECT_GE(outcome.frames.size(), 3u);
  EXPECT_LT(outcome.frames.size(), static_cast<std::size_t>(kFrames));
  EXPECT_LT(outcome.iterations, 20);
  EXPECT_GT(mapping.slam_run->backbone().primitives(), 0u);
}

TEST(SlamRun, a_stop_before_mapping_keeps_the_keyframes) {
  Mapping mapping;
  std::atomic<bool> stop = false;
  mapping.slam.initial_keyframes = 100;
  mapping.sequence.before_frame = [&](std::size_t number) { stop = number == 8; };
  mapping.stopped = [&] { return stop.load(); };
  const SlamOutcome outcome = mapping.run();
  EXPECT_EQ(outcome.frames.size(), 9u);
  EXPECT_EQ(outcome.iterations, 0);
  EXPECT_GE(mapping.slam_run->scene().train.size(), 2u);
  EXPECT_GT(mapping.slam_run->backbone().primitives(), 0u);
}

TEST(SlamRun, a_stop_before_mapping_makes_no_model_if_none_is_wanted) {
  // The keyframe that would begin mapping may be on its way to the mapper.
  for (const int initial_keyframes : {2, 100}) {
    Mapping mapping;
    std::atomic<bool> stop = false;
    mapping.slam.keep_untrained = false;
    mapping.slam.initial_keyframes = initial_keyframes;
    mapping.sequence.before_frame = [&](std::size_t number) { stop = initial_keyframes == 2 || number == 8; };
    mapping.sequence.changed = [&](SequenceFrame&) { stop = stop || initial_keyframes == 2; };
    mapping.stopped = [&] { return stop.load(); };
    EXPECT_FALSE(mapping.run().complete);
    EXPECT_FALSE(mapping.slam_run->has_model());
  }
}

TEST(SlamRun, a_failure_before_mapping_makes_no_model_if_none_is_wanted) {
  Mapping mapping;
  mapping.slam.keep_untrained = false;
  mapping.slam.initial_keyframes = 100;
  mapping.sequence.before_frame = [](std::size_t number) {
    if (number == 9) throw std::bad_alloc();
  };
  const SlamOutcome outcome = mapping.run();
  EXPECT_THROW(std::rethrow_exception(outcome.failure), std::bad_alloc);
  EXPECT_FALSE(mapping.slam_run->has_model());
}

TEST(SlamRun, a_run_with_few_keyframes_is_mapped_at_its_end) {
  Mapping mapping;
  mapping.slam.keep_untrained = false;
  mapping.slam.initial_keyframes = 100;
  EXPECT_TRUE(mapping.run().complete);
  EXPECT_TRUE(mapping.slam_run->has_model());
}

TEST(SlamRun, a_stop_before_the_first_keyframe_leaves_nothing) {
  Mapping mapping;
  mapping.stopped = [] { return true; };
  EXPECT_FALSE(mapping.run().complete);
  EXPECT_TRUE(mapping.slam_run->scene().train.empty());
}

TEST(SlamRun, keeps_what_it_has_where_memory_runs_out_for_the_tracker) {
  Mapping mapping;
  mapping.sequence.before_frame = [](std::size_t number) {
    if (number == 9) throw std::bad_alloc();
  };
  const SlamOutcome outcome = mapping.run();
  EXPECT_THROW(std::rethrow_exception(outcome.failure), std::bad_alloc);
  EXPECT_EQ(outcome.frames.size(), 9u);
  EXPECT_EQ(mapping.slam_run->scene().train.size(), outcome.keyframe_frames.size());
  EXPECT_GT(mapping.slam_run->backbone().primitives(), 0u);
}

TEST(SlamRun, keeps_what_it_has_where_memory_runs_out_for_the_mapper) {
  Mapping mapping;
  mapping.slam.lockstep = 5;
  int asked = 0;
  mapping.stopped = [&] {
    if (++asked == 12) throw std::bad_alloc();
    return false;
  };
  const SlamOutcome outcome = mapping.run();
  EXPECT_THROW(std::rethrow_exception(outcome.failure), std::bad_alloc);
  EXPECT_FALSE(outcome.complete);
  EXPECT_GT(outcome.iterations, 0);
  EXPECT_GE(mapping.slam_run->scene().train.size(), 2u);
}

TEST(SlamRun, after_a_change_that_failed_none_is_taken) {
  Mapping mapping;
  std::atomic<std::size_t> read = 0;
  mapping.sequence.before_frame = [&](std::size_t number) { read = number; };
  std::vector<std::size_t> views;
  mapping.before_backbone = [&](const Scene& scene) {
    views.push_back(scene.train.size());
    if (views.size() > 1) return;
    while (read + 1 < kFrames) std::this_thread::yield();  // by then further changes are queued
    throw std::bad_alloc();
  };
  const SlamOutcome outcome = mapping.run();
  EXPECT_THROW(std::rethrow_exception(outcome.failure), std::bad_alloc);
  EXPECT_GE(outcome.keyframe_frames.size(), 4u);
  EXPECT_EQ(views, (std::vector<std::size_t>{2, 2}));
  EXPECT_EQ(mapping.slam_run->scene().train.size(), 2u);
}

TEST(SlamRun, what_a_user_must_mend_is_not_kept) {
  Mapping mapping;
  mapping.sequence.before_frame = [](std::size_t number) {
    if (number == 9) throw InputError("the card was pulled");
  };
  EXPECT_THROW(mapping.run(), InputError);
}

void expect_in(const std::string& text, const std::string& part) {
  EXPECT_NE(text.find(part), std::string::npos) << text;
}

void blur(SequenceFrame& frame, int radius) {
  const std::vector<std::uint8_t> sharp = frame.color;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      for (int c = 0; c < 3; ++c) {
        int sum = 0;
        for (int i = -radius; i <= radius; ++i) {
          sum += sharp[static_cast<std::size_t>(3 * (y * kWidth + std::clamp(x + i, 0, kWidth - 1)) + c)];
        }
        frame.color[static_cast<std::size_t>(3 * (y * kWidth + x) + c)] =
            static_cast<std::uint8_t>(sum / (2 * radius + 1));
      }
    }
  }
}

TEST(HardInput, a_good_walk_needs_no_word) {
  Mapping mapping;
  EXPECT_EQ(mapping.lines(), "");
  EXPECT_EQ(mapping.count(TrackState::tracked), static_cast<std::size_t>(kFrames));
}

TEST(HardInput, wrong_focal_lengths_are_told) {
  const synthetic::Intrinsics camera(kWidth, kHeight);
  for (const double factor : {0.5, 2.0}) {
    Mapping mapping(2 * kFrames, factor);
    const std::string lines = mapping.lines();
    expect_in(lines, "fit focal lengths of about ");
    const double told = std::stod(lines.substr(lines.find("of about ") + 9));
    EXPECT_NEAR(told, camera.focal, 0.15 * camera.focal);
  }
}

TEST(HardInput, focal_lengths_that_depth_was_computed_with_are_not_checked) {
  Mapping mapping(2 * kFrames, 0.5);
  mapping.sequence.stereo = true;
  EXPECT_EQ(mapping.lines(), "");
}

/// The pictures and the warnings of measuring the run's frames.
struct Measured {
  explicit Measured(Mapping& mapping) {
    mapping.lines();
    ::testing::internal::CaptureStderr();
    std::vector<ReportView> views;
    measure_frames(
        *mapping.slam_run, mapping.outcome, mapping.sequence, -1, nullptr, folder.path(), [] { return false; }, results,
        views);
    lines = ::testing::internal::GetCapturedStderr();
    for (const auto& entry : std::filesystem::directory_iterator(folder / "test/truth")) {
      pictures.insert(entry.path().filename().string());
    }
  }
  const test::TemporaryFolder folder;
  Results results;
  std::string lines;
  std::set<std::string> pictures;
};

TEST(Measuring, frames_that_can_no_longer_be_read_are_told) {
  Mapping mapping;
  EXPECT_EQ(Measured(mapping).lines, "");
  bool gone = false;
  Mapping other;
  other.sequence.changed = [&](SequenceFrame& frame) {
    gone = gone || frame.number + 1 == kFrames;
    if (gone && frame.number < 8) frame.color.clear();
  };
  const Measured some(other);
  EXPECT_EQ(some.lines, "warning: 8 of 12 tracked frames could not be read again; measured on 4\n");
  EXPECT_EQ(some.results.views.size(), 4u);
}

TEST(Measuring, pictures_of_one_stem_have_the_names_of_their_folders) {
  Mapping mapping;
  EXPECT_TRUE(Measured(mapping).pictures.contains("11.png"));
  Mapping other;
  other.sequence.name = [](std::size_t number) { return std::to_string(number) + "/0.png"; };
  const Measured measured(other);
  EXPECT_EQ(measured.pictures.size(), 8u);
  EXPECT_TRUE(measured.pictures.contains("11_0.png"));
  const test::TemporaryFolder folder;
  write_tracking(*other.slam_run, other.outcome, other.sequence, folder.path());
  EXPECT_TRUE(std::filesystem::exists(folder / "keyframes/images/0_0.png"));
}

nlohmann::json some_results() {
  return {{"iterations", 253},
          {"psnr", 21.5},
          {"split", "tracked"},
          {"views", nlohmann::json::array({1, 2, 3})},
          {"slam",
           {{"complete", true},
            {"frames", 300},
            {"tracked", 3},
            {"lost", 0},
            {"dropped", 0},
            {"waiting", 0},
            {"keyframes", {{"frames", 1}, {"psnr", 25.25}}},
            {"map_points", 9},
            {"loops", 1},
            {"depth", true},
            {"ate_rmse", nullptr},
            {"path_length", nullptr},
            {"tracking_fps", 9.96}}}};
}

TEST(Results, lines_on_tracking) {
  nlohmann::json results = some_results();
  EXPECT_EQ(tracking_lines(results),
            (std::vector<std::string>{"frames: 3 of 300 tracked at 10.0 per second, 1 keyframe, 9 points, 1 loop",
                                      "PSNR: 21.50 dB over all tracked frames, 25.25 dB over keyframes"}));
  nlohmann::json& slam = results["slam"];
  slam["complete"] = false;
  slam["lost"] = 2;
  slam["dropped"] = 1;
  slam["tracked"] = 45;
  slam["ate_rmse"] = 0.01234;
  slam["path_length"] = 1.5;
  slam["depth"] = false;
  slam["keyframes"]["psnr"] = nullptr;
  EXPECT_EQ(tracking_lines(results),
            (std::vector<std::string>{
                "interrupted after frame 48 of 300, iteration 253",
                "frames: 45 of 300 tracked at 10.0 per second, 2 lost, 1 dropped, 1 keyframe, 9 points, 1 loop",
                "trajectory: ATE 0.0123 m (RMSE, after alignment with scale) on a path of 1.50 m",
                "PSNR: 21.50 dB over 3 of 45 tracked frames"}));
  results["split"] = "train";
  EXPECT_EQ(tracking_lines(results).size(), 3u);
}

TEST(HardInput, no_depth_at_all) {
  Mapping mapping;
  const std::string lines = mapping.lines_without(&SequenceFrame::depth, "has no depth image");
  expect_in(lines, "frame 0 (0.png): has no depth image; left out, because a map begins with depth");
  expect_in(lines, "further messages of this kind are not printed");
  expect_in(lines, "nothing could be tracked: in 12 of 12 frames there is no depth that can be used");
  expect_in(lines, "see the messages about single frames");
}

TEST(HardInput, no_image_at_all) {
  Mapping mapping;
  const std::string lines = mapping.lines_without(&SequenceFrame::color, "cannot be read");
  expect_in(lines, "frame 0 (0.png): cannot be read; left out");
  expect_in(lines, "nothing could be tracked: not one image can be used");
  EXPECT_EQ(lines.find("depth_scale"), std::string::npos) << lines;
}

TEST(WithoutDepth, goes_to_its_end) {
  Mapping mapping(2 * kFrames);
  mapping.sequence.forget_depth();
  EXPECT_EQ(mapping.lines(), "");
  EXPECT_TRUE(mapping.outcome.complete);
  // The map begins with two keyframes at once, the first of an earlier frame.
  const std::vector<std::size_t>& of = mapping.outcome.keyframe_frames;
  ASSERT_GE(of.size(), 4u);
  EXPECT_EQ(of[0], 0u);
  EXPECT_GT(of[1], 1u);
  EXPECT_TRUE(std::ranges::is_sorted(of));
  const std::vector<TrackedFrame>& frames = mapping.outcome.frames;
  EXPECT_EQ(frames[0].state, TrackState::tracked);
  EXPECT_EQ(frames[0].keyframe, 0u);
  EXPECT_EQ(frames[1].state, TrackState::waiting);
  for (std::size_t i = of[1]; i < frames.size(); ++i) EXPECT_EQ(frames[i].state, TrackState::tracked) << i;
  const Scene& scene = mapping.slam_run->scene();
  ASSERT_EQ(scene.train.size(), of.size());
  for (std::size_t i = 0; i < of.size(); ++i) {
    const SequenceFrame frame = mapping.sequence.read(of[i]);
    EXPECT_EQ(scene.train[i].name, frame.name);
    EXPECT_EQ(scene.train[i].color[0], frame.color[0]);
  }
}

TEST(WithoutDepth, a_map_that_is_lost_early_is_not_mapped) {
  constexpr std::size_t kAgain = 2 * (kFrames - 1);  // there, the walk is where it began
  Mapping plain(2 * kFrames);
  plain.sequence.forget_depth();
  EXPECT_EQ(plain.lines(), "");
  Mapping mapping(kAgain + 2 * kFrames);
  mapping.sequence.forget_depth();
  const std::size_t first_lost = plain.outcome.keyframe_frames.at(1) + 1;  // the map has two keyframes
  ASSERT_LE(first_lost + 5, kAgain);
  mapping.sequence.changed = [&](SequenceFrame& frame) {
    frame.depth.clear();
    if (frame.number >= first_lost && frame.number < kAgain) std::ranges::fill(frame.color, std::uint8_t{90});
  };
  const std::string lines = mapping.lines();
  expect_in(lines, "frame " + std::to_string(first_lost) + " (");
  expect_in(lines, ": tracking lost");
  expect_in(lines, "frame " + std::to_string(first_lost + 4) + " (");
  expect_in(lines, ": the map was dropped, because it was lost soon after it had begun; another one begins");
  EXPECT_EQ(std::ranges::count(lines, '\n'), 2) << lines;
  EXPECT_EQ(mapping.count(TrackState::lost), 4u);
  EXPECT_EQ(mapping.count(TrackState::tracked), plain.count(TrackState::tracked));

  std::vector<std::size_t> expected = plain.outcome.keyframe_frames;
  for (std::size_t& frame : expected) frame += kAgain;
  ASSERT_EQ(mapping.outcome.keyframe_frames, expected);
  const std::vector<View>&views = mapping.slam_run->scene().train, &plain_views = plain.slam_run->scene().train;
  ASSERT_EQ(views.size(), expected.size());
  ASSERT_EQ(plain_views.size(), expected.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_EQ(views[i].color[0], plain_views[i].color[0]);
    EXPECT_EQ(views[i].camera.camera_from_world, plain_views[i].camera.camera_from_world);
  }
  EXPECT_EQ(mapping.slam_run->scene().points.positions, plain.slam_run->scene().points.positions);
}

TEST(WithoutDepth, a_map_with_few_keyframes_at_the_end_is_mapped) {
  Mapping whole(2 * kFrames);
  whole.sequence.forget_depth();
  whole.lines();
  const std::size_t second = whole.outcome.keyframe_frames.at(1);
  Mapping mapping(second + 1);
  mapping.sequence.forget_depth();
  EXPECT_EQ(mapping.lines(), "");
  EXPECT_EQ(mapping.outcome.keyframe_frames, (std::vector<std::size_t>{0, second}));
  EXPECT_EQ(mapping.slam_run->scene().train.size(), 2u);
  EXPECT_GT(mapping.slam_run->backbone().primitives(), 0u);
}

TEST(WithoutDepth, a_camera_that_only_turns_is_told_so) {
  static const std::vector<SequenceFrame> turning = testing::walk_frames(kWidth, kHeight, kFrames, 120, true);
  Mapping mapping;
  mapping.sequence.forget_depth();
  mapping.sequence.changed = [](SequenceFrame& frame) {
    frame.color = turning[frame.number].color;
    frame.depth.clear();
  };
  const std::string lines = mapping.lines();
  expect_in(lines, "nothing could be tracked: no two frames show enough of the same features from different places");
  EXPECT_EQ(lines.find('\n'), std::string::npos) << lines;
}

TEST(WithoutDepth, a_video_is_tracked) {
  constexpr int kWide = 320, kHigh = 240, kCount = 20;
  constexpr std::size_t kPlane = kWide * kHigh;
  const test::TemporaryFolder folder;
  VideoFile video(folder / "walk.mp4", kWide, kHigh, 30);
  for (const SequenceFrame& frame : testing::walk_frames(kWide, kHigh, kCount, kWalkFrames)) {
    std::vector<float> planes(3 * kPlane);
    for (std::size_t i = 0; i < planes.size(); ++i) {
      planes[i] = static_cast<float>(frame.color[3 * (i % kPlane) + i / kPlane]) / 255;
    }
    video.add(planes);
  }
  video.finish();
  const double focal = synthetic::Intrinsics(kWide, kHigh).focal;
  std::ofstream(folder / "camera.json") << R"({"width": 320, "height": 240, "fx": )" << focal << R"(, "fy": )" << focal
                                        << R"(, "cx": 159.5, "cy": 119.5})";
  SequenceOptions options;
  options.source = folder / "walk.mp4";
  options.calibration = folder / "camera.json";
  const auto sequence = open_sequence(options);
  ASSERT_EQ(sequence->size(), static_cast<std::size_t>(kCount));
  Tracker tracker(sequence->calibration(), {});
  std::vector<TrackedFrame> frames;
  for (std::size_t i = 0; i < sequence->size(); ++i) frames.push_back(tracker.track(sequence->read(i)));
  std::vector<glm::dvec3> found, truth;
  for (const TrackedFrame& frame : frames) {
    EXPECT_NE(frame.state, TrackState::lost) << frame.frame;
    if (frame.state != TrackState::tracked) continue;
    found.emplace_back(glm::inverse(tracker.camera_from_world(frame))[3]);
    truth.push_back(walk_pose(static_cast<int>(frame.frame), kWalkFrames).centre);
  }
  EXPECT_GE(found.size(), 10u);
  EXPECT_LT(align(found, truth, true).rmse, 0.03);  // on a path of 0.7 m
}

TEST(HardInput, depth_for_every_third_frame) {
  Mapping mapping;
  mapping.sequence.changed = [](SequenceFrame& frame) {
    if (frame.number % 3 != 0) frame.depth.clear();
  };
  mapping.lines();
  EXPECT_EQ(mapping.count(TrackState::tracked), static_cast<std::size_t>(kFrames));
  for (const std::size_t keyframe : mapping.outcome.keyframe_frames) EXPECT_EQ(keyframe % 3, 0u);
}

TEST(HardInput, frames_that_were_dropped) {
  Mapping mapping;
  mapping.sequence.changed = [](SequenceFrame& frame) {
    if (frame.number < 4 || frame.number > 6) return;
    frame.color.clear();
    frame.problem = "cannot be read";
  };
  const std::string lines = mapping.lines();
  expect_in(lines, "frame 5 (5.png): cannot be read; left out");
  EXPECT_EQ(mapping.count(TrackState::dropped), 3u);
  EXPECT_EQ(mapping.count(TrackState::tracked), static_cast<std::size_t>(kFrames - 3));
}

TEST(HardInput, blurred_frames_are_lost_and_tracking_goes_on) {
  Mapping mapping;
  mapping.sequence.changed = [](SequenceFrame& frame) {
    if (frame.number >= 5 && frame.number <= 6) blur(frame, 20);
  };
  const std::string lines = mapping.lines();
  expect_in(lines, "frame 5 (5.png): tracking lost");
  expect_in(lines, "frame 7 (7.png): tracking resumed");
  EXPECT_EQ(mapping.count(TrackState::lost), 2u);
  EXPECT_EQ(mapping.outcome.frames.back().state, TrackState::tracked);
}

TEST(HardInput, a_little_blur_does_no_harm) {
  Mapping mapping;
  mapping.sequence.changed = [](SequenceFrame& frame) {
    if (frame.number >= 5 && frame.number <= 6) blur(frame, 1);
  };
  EXPECT_EQ(mapping.lines(), "");
  EXPECT_EQ(mapping.count(TrackState::tracked), static_cast<std::size_t>(kFrames));
}

TEST(HardInput, lost_for_good) {
  Mapping mapping;
  mapping.sequence.changed = [](SequenceFrame& frame) {
    if (frame.number >= 4) std::ranges::fill(frame.color, std::uint8_t{90});
  };
  const std::string lines = mapping.lines();
  expect_in(lines, "frame 4 (4.png): tracking lost");
  EXPECT_EQ(std::ranges::count(lines, '\n'), 1);
  EXPECT_EQ(mapping.count(TrackState::lost), static_cast<std::size_t>(kFrames - 4));
  EXPECT_TRUE(mapping.outcome.complete);
}

}  // namespace
}  // namespace splatboost::program

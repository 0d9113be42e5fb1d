// SPDX-License-Identifier: Apache-2.0
// Tracking and mapping together, on the beginning of a ray-traced walk: runs that end early keep what they have.
#include "program/session/slam_run.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <functional>
#include <new>
#include <stdexcept>
#include <utility>

#include "photo_slam/photo_slam.h"
#include "splatboost/threads.h"
#include "trainer/support/input_error.h"
#include "trainer/synth/synth_view.h"
#include "trainer/synth/synth_walk.h"

namespace splatboost::program {
namespace {

constexpr int kWidth = 160, kHeight = 120, kFrames = 12;

/// Made once: ray tracing takes most of the time here.
const std::vector<Frame>& walk() {
  static const std::vector<Frame> frames = [] {
    const auto world = synthetic::make_room();
    const synthetic::Intrinsics camera(kWidth, kHeight);
    Threads threads;
    std::vector<Frame> made;
    for (int i = 0; i < kFrames; ++i) {
      synthetic::Picture picture(camera);
      synthetic::render_view(*world, camera, walk_pose(i, 120), 1, threads, picture);
      Frame frame;
      frame.name = std::to_string(i) + ".png";
      frame.width = kWidth;
      frame.height = kHeight;
      frame.color = picture.color;
      frame.depth.assign(picture.depth.begin(), picture.depth.end());
      made.push_back(std::move(frame));
    }
    return made;
  }();
  return frames;
}

/// The walk, forward and backward in turn for as long as it is asked for.
class Walk final : public Sequence {
 public:
  explicit Walk(std::size_t size) : size_(size) {
    const synthetic::Intrinsics camera(kWidth, kHeight);
    calibration_.width = kWidth;
    calibration_.height = kHeight;
    calibration_.fx = calibration_.fy = camera.focal;
    calibration_.cx = camera.cx - 0.5;
    calibration_.cy = camera.cy - 0.5;
    calibration_.depth_scale = 1000;
  }
  std::size_t size() const override { return size_; }
  const Calibration& calibration() const override { return calibration_; }
  double time_of(std::size_t number) const override { return static_cast<double>(number) / 30; }
  std::optional<glm::dmat4> truth(std::size_t) const override { return std::nullopt; }
  Frame read(std::size_t number) override {
    if (before_frame) before_frame(number);
    const std::size_t way = number / (kFrames - 1), step = number % (kFrames - 1);
    Frame frame = walk()[way % 2 == 0 ? step : kFrames - 1 - step];
    frame.number = number;
    frame.time = time_of(number);
    return frame;
  }

  std::function<void(std::size_t)> before_frame;

 private:
  std::size_t size_;
  Calibration calibration_;
};

struct Mapping {
  explicit Mapping(std::size_t frames = kFrames) : sequence(frames), threads(2) {
    slam.tracker.features = 400;
    slam.initial_keyframes = 2;
    options.iterations = 20;
    options.quiet = true;
  }
  SlamOutcome run() {
    slam_run.emplace(
        sequence, slam, options,
        [&](const Scene& scene) {
          return PluggedBackbone{
              nullptr, make_photo_slam({scene, threads, 0, *options.iterations, 0, threads}, {}), {}};
        },
        stopped);
    return slam_run->run();
  }

  Walk sequence;
  SlamOptions slam;
  RunOptions options;
  Threads threads;
  std::function<bool()> stopped = [] { return false; };
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

TEST(SlamRun, what_a_user_must_mend_is_not_kept) {
  Mapping mapping;
  mapping.sequence.before_frame = [](std::size_t number) {
    if (number == 9) throw InputError("the card was pulled");
  };
  EXPECT_THROW(mapping.run(), InputError);
}

}  // namespace
}  // namespace splatboost::program

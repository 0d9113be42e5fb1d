// SPDX-License-Identifier: Apache-2.0
// The tracker on the beginning of a ray-traced walk.
#include "families/tracking/tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "families/tracking/features.h"
#include "splatboost/threads.h"
#include "support/walk_frames.h"
#include "trainer/sequence/trajectory.h"
#include "trainer/synth/synth_view.h"
#include "trainer/synth/synth_walk.h"

namespace splatboost {
namespace {

constexpr int kWidth = 240, kHeight = 180, kFrames = 16;
constexpr int kElsewhere = 170;  ///< frame of the walk that shows nothing of its beginning

const std::vector<SequenceFrame>& walk() {
  static const std::vector<SequenceFrame> frames = testing::walk_frames(kWidth, kHeight, kFrames, kWalkFrames);
  return frames;
}

Calibration calibration(int width = kWidth, int height = kHeight) {
  const synthetic::Intrinsics camera(width, height);
  Calibration c;
  c.width = width;
  c.height = height;
  c.fx = c.fy = camera.focal;
  c.cx = camera.cx - 0.5;
  c.cy = camera.cy - 0.5;
  c.depth_scale = 1000;
  return c;
}

TrackerOptions options() {
  TrackerOptions o;
  o.features = 400;
  return o;
}

/// With more features, more match by chance.
TrackerOptions many_features() {
  TrackerOptions o;
  o.features = 1000;
  return o;
}

/// Absolute trajectory error of tracked frames.
double error_of(const Tracker& tracker, const std::vector<TrackedFrame>& frames, bool with_scale = false) {
  std::vector<glm::dvec3> found, truth;
  for (const TrackedFrame& frame : frames) {
    if (frame.state != TrackState::tracked) continue;
    found.emplace_back(glm::inverse(tracker.camera_from_world(frame))[3]);
    truth.push_back(walk_pose(static_cast<int>(frame.frame), kWalkFrames).centre);
  }
  return align(found, truth, with_scale).rmse;
}

TEST(Tracker, follows_a_walk) {
  Tracker tracker(calibration(), options());
  std::vector<TrackedFrame> frames;
  for (const SequenceFrame& frame : walk()) frames.push_back(tracker.track(frame));
  for (const TrackedFrame& frame : frames) EXPECT_EQ(frame.state, TrackState::tracked) << frame.frame;
  EXPECT_GE(tracker.keyframes(), 3u);
  EXPECT_LT(tracker.keyframes(), static_cast<std::size_t>(kFrames));
  EXPECT_LT(error_of(tracker, frames), 0.01);  // on a path of 0.7 m
  EXPECT_EQ(tracker.loops(), 0);
}

TEST(Tracker, the_same_frames_give_the_same_poses) {
  const auto poses = [] {
    Tracker tracker(calibration(), options());
    std::vector<glm::dmat4> found;
    for (const SequenceFrame& frame : walk()) tracker.track(frame);
    for (std::size_t i = 0; i < tracker.keyframes(); ++i) found.push_back(tracker.camera_from_world(i));
    return found;
  };
  EXPECT_EQ(poses(), poses());
}

TEST(Tracker, adds_no_keyframe_where_it_has_been) {
  Tracker tracker(calibration(), options());
  std::size_t number = 0;
  const auto pass = [&](bool forward) {
    for (std::size_t i = 0; i < walk().size(); ++i) {
      SequenceFrame frame = walk()[forward ? i : walk().size() - 1 - i];
      frame.number = number++;
      EXPECT_EQ(tracker.track(frame).state, TrackState::tracked) << number;
    }
  };
  const auto there_and_back = [&] { pass(true), pass(false); };
  there_and_back();
  there_and_back();
  const std::size_t keyframes = tracker.keyframes(), points = tracker.map_points();
  for (int again = 0; again < 2; ++again) there_and_back();
  EXPECT_EQ(tracker.keyframes(), keyframes);
  EXPECT_EQ(tracker.map_points(), points);
}

TEST(Tracker, tells_what_is_new_once) {
  Tracker tracker(calibration(), options());
  tracker.track(walk()[0]);
  const MapChange first = tracker.take_change();
  EXPECT_EQ(first.map_points.points.size(), tracker.map_points());
  EXPECT_EQ(first.map_points.views.size(), first.map_points.points.size());
  EXPECT_EQ(first.features.points.size(), first.map_points.points.size());
  EXPECT_TRUE(first.corrections.empty());
  EXPECT_EQ(tracker.take_change().map_points.points.size(), 0u);
}

TEST(Tracker, is_lost_and_finds_itself_again) {
  Tracker tracker(calibration(), options());
  SequenceFrame missing = walk()[0];
  missing.color.clear();
  EXPECT_EQ(tracker.track(missing).state, TrackState::dropped) << "not readable, whether there is a map or not";
  for (int i = 0; i < 8; ++i) tracker.track(walk()[static_cast<std::size_t>(i)]);
  SequenceFrame wall = walk()[8];
  std::ranges::fill(wall.color, std::uint8_t{128});
  EXPECT_EQ(tracker.track(wall).state, TrackState::lost);
  SequenceFrame unreadable = walk()[9];
  unreadable.color.clear();
  EXPECT_EQ(tracker.track(unreadable).state, TrackState::dropped);
  const TrackedFrame back = tracker.track(walk()[5]);
  EXPECT_EQ(back.state, TrackState::tracked);
  EXPECT_TRUE(back.relocalized);
  const glm::dvec3 found(glm::inverse(tracker.camera_from_world(back))[3]);
  EXPECT_NEAR(glm::length(found), glm::length(walk_pose(5, kWalkFrames).centre - walk_pose(0, kWalkFrames).centre),
              0.02);
}

/// Between the frames features move farther than the tracker looks at first, where some match by chance.
TEST(Tracker, a_fast_camera_is_not_located_by_chance) {
  Tracker tracker(calibration(), many_features());
  std::vector<TrackedFrame> frames;
  for (const std::size_t i : {0u, 5u, 10u, 15u}) frames.push_back(tracker.track(walk()[i]));
  for (const TrackedFrame& frame : frames) EXPECT_EQ(frame.state, TrackState::tracked) << frame.frame;
  EXPECT_LT(error_of(tracker, frames), 0.03);
}

TEST(Tracker, a_jump_to_another_place_is_no_tracking) {
  const auto room = synthetic::make_room();
  const synthetic::Intrinsics camera(kWidth, kHeight);
  Threads threads;
  Tracker tracker(calibration(), many_features());
  for (const SequenceFrame& frame : walk()) tracker.track(frame);
  const std::size_t keyframes = tracker.keyframes();
  for (int i = 0; i < 2; ++i) {
    synthetic::Picture picture(camera);
    synthetic::render_view(*room, camera, walk_pose(kElsewhere + i, kWalkFrames), 1, threads, picture);
    SequenceFrame frame = walk()[0];
    frame.number = walk().size() + static_cast<std::size_t>(i);
    frame.color = picture.color;
    frame.depth.assign(picture.depth.begin(), picture.depth.end());
    EXPECT_EQ(tracker.track(frame).state, TrackState::lost) << i;
  }
  EXPECT_EQ(tracker.keyframes(), keyframes);
}

TEST(Tracker, frames_without_depth_are_tracked_but_no_keyframes) {
  Tracker tracker(calibration(), options());
  SequenceFrame flat = walk()[0];
  flat.depth.clear();
  EXPECT_EQ(tracker.track(flat).state, TrackState::waiting);
  for (int i = 0; i < 4; ++i) tracker.track(walk()[static_cast<std::size_t>(i)]);
  const std::size_t keyframes = tracker.keyframes();
  flat = walk()[6];
  flat.depth.clear();
  const TrackedFrame tracked = tracker.track(flat);
  EXPECT_EQ(tracked.state, TrackState::tracked);
  EXPECT_FALSE(tracked.is_keyframe);
  EXPECT_EQ(tracker.keyframes(), keyframes);
}

SequenceFrame grey(SequenceFrame frame) {
  std::ranges::fill(frame.color, std::uint8_t{128});
  return frame;
}

TEST(Tracker, says_what_frames_lack_to_begin_a_map) {
  TrackerOptions range = options();
  range.nearest_depth = 0.001;
  range.farthest_depth = 0.01;
  Tracker near(calibration(), range);
  near.track(grey(walk()[0]));
  SequenceFrame frame = walk()[0];
  frame.depth.clear();
  near.track(frame);
  frame.depth.assign(walk()[0].depth.size(), 0.0f);
  near.track(frame);
  for (std::size_t i = 0; i < 3; ++i) near.track(walk()[i]);
  const LackOfMap& lack = near.lack_of_map();
  EXPECT_EQ(lack.few_features, 1u);
  EXPECT_EQ(lack.no_depth, 1u);
  EXPECT_EQ(lack.few_depths, 1u);
  EXPECT_EQ(lack.too_far, 3u);
  EXPECT_EQ(lack.too_near + lack.no_parallax, 0u);
  EXPECT_GT(lack.most_features, 200u);
  EXPECT_GT(lack.most_depths, 100u);
  const auto [least, most] = std::ranges::minmax(walk()[0].depth);
  EXPECT_GE(lack.nearest, 0.8 * least);
  EXPECT_LE(lack.farthest, 1.2 * most);
  EXPECT_LT(lack.nearest, lack.farthest);

  range.nearest_depth = 1000;
  range.farthest_depth = 2000;
  Tracker far(calibration(), range);
  far.track(walk()[0]);
  EXPECT_EQ(far.lack_of_map().too_near, 1u);

  Tracker good(calibration(), options());
  for (const SequenceFrame& each : walk()) good.track(each);
  const LackOfMap& none = good.lack_of_map();
  EXPECT_EQ(none.few_features + none.no_depth + none.few_depths + none.too_near + none.too_far, 0u);
}

/// Without depth, small images are tracked less accurately.
class TrackerWithoutDepth : public ::testing::Test {
 protected:
  static constexpr int kWide = 320, kHigh = 240, kCount = 24;

  static std::vector<SequenceFrame> frames_of(bool turns_only) {
    std::vector<SequenceFrame> frames = testing::walk_frames(kWide, kHigh, kCount, kWalkFrames, turns_only);
    for (SequenceFrame& frame : frames) frame.depth.clear();
    return frames;
  }
  static const std::vector<SequenceFrame>& frames() {
    static const std::vector<SequenceFrame> made = frames_of(false);
    return made;
  }
  TrackerWithoutDepth() : calibration_(calibration(kWide, kHigh)) {
    calibration_.depth_scale = 0;
    options_.features = 600;
  }

  Calibration calibration_;
  TrackerOptions options_;
};

TEST_F(TrackerWithoutDepth, follows_a_walk_up_to_its_scale) {
  Tracker tracker(calibration_, options_);
  std::vector<TrackedFrame> tracked;
  for (const SequenceFrame& frame : frames()) tracked.push_back(tracker.track(frame));
  std::size_t begun = 0;
  while (begun < tracked.size() && tracked[begun].state == TrackState::waiting) ++begun;
  ASSERT_GE(begun, 1u);
  ASSERT_LE(begun, 10u);
  EXPECT_TRUE(tracked[begun].is_keyframe);
  EXPECT_EQ(tracked[begun].keyframe, 1u);
  EXPECT_EQ(tracker.frame_of(0), 0u);
  EXPECT_EQ(tracker.frame_of(1), begun);
  for (std::size_t i = begun; i < tracked.size(); ++i) EXPECT_EQ(tracked[i].state, TrackState::tracked) << i;
  EXPECT_GE(tracker.keyframes(), 4u);
  EXPECT_GT(tracker.map_points(), 200u);

  // A run's error depends much on the two views that its map begins with.
  std::vector<double> errors{error_of(tracker, tracked, true)};
  for (const int features : {400, 500, 700, 800}) {
    TrackerOptions other = options_;
    other.features = features;
    Tracker again(calibration_, other);
    std::vector<TrackedFrame> run;
    for (const SequenceFrame& frame : frames()) run.push_back(again.track(frame));
    errors.push_back(error_of(again, run, true));
  }
  std::ranges::sort(errors);
  EXPECT_LT(errors[errors.size() / 2], 0.015) << ::testing::PrintToString(errors);  // on a path of 0.8 m
}

TEST_F(TrackerWithoutDepth, the_same_frames_give_the_same_poses) {
  const auto poses = [&] {
    Tracker tracker(calibration_, options_);
    for (const SequenceFrame& frame : frames()) tracker.track(frame);
    std::vector<glm::dmat4> found;
    for (std::size_t i = 0; i < tracker.keyframes(); ++i) found.push_back(tracker.camera_from_world(i));
    return found;
  };
  EXPECT_EQ(poses(), poses());
}

TEST_F(TrackerWithoutDepth, a_camera_that_only_turns_gives_no_map) {
  Tracker tracker(calibration_, options_);
  for (const SequenceFrame& frame : frames_of(true)) {
    EXPECT_EQ(tracker.track(frame).state, TrackState::waiting) << frame.number;
  }
  EXPECT_EQ(tracker.keyframes(), 0u);
  EXPECT_EQ(tracker.lack_of_map().no_parallax, static_cast<std::size_t>(kCount));
  tracker.track(grey(frames()[0]));
  EXPECT_EQ(tracker.lack_of_map().few_features, 1u);
}

TEST_F(TrackerWithoutDepth, a_map_that_is_lost_early_is_dropped) {
  Tracker tracker(calibration_, options_);
  std::size_t number = 0;
  const auto next = [&](SequenceFrame frame) {
    frame.number = number++;
    return tracker.track(frame);
  };
  for (std::size_t i = 0; i < frames().size() && tracker.keyframes() == 0; ++i) next(frames()[i]);
  ASSERT_EQ(tracker.keyframes(), 2u);
  EXPECT_TRUE(tracker.on_trial());
  for (int lost = 1; lost < 5; ++lost) EXPECT_EQ(next(grey(frames()[0])).state, TrackState::lost);
  EXPECT_EQ(tracker.keyframes(), 2u);
  const TrackedFrame dropped = next(grey(frames()[0]));
  EXPECT_TRUE(dropped.begins_anew);
  EXPECT_EQ(dropped.state, TrackState::waiting);
  EXPECT_EQ(tracker.keyframes(), 0u);
  EXPECT_EQ(tracker.map_points(), 0u);
  EXPECT_TRUE(tracker.take_change().map_points.views.empty());

  // Nothing of the first map is left in the second.
  const std::size_t again = number;
  Tracker fresh(calibration_, options_);
  for (const SequenceFrame& frame : frames()) EXPECT_EQ(next(frame).state, fresh.track(frame).state) << frame.number;
  ASSERT_GE(fresh.keyframes(), 4u);
  ASSERT_EQ(tracker.keyframes(), fresh.keyframes());
  EXPECT_EQ(tracker.map_points(), fresh.map_points());
  for (std::size_t i = 0; i < fresh.keyframes(); ++i) {
    EXPECT_EQ(tracker.frame_of(i), again + fresh.frame_of(i));
    EXPECT_EQ(tracker.camera_from_world(i), fresh.camera_from_world(i)) << i;
  }
}

TEST_F(TrackerWithoutDepth, a_map_that_is_lost_later_is_kept) {
  options_.keyframe_gap = 3;
  Tracker tracker(calibration_, options_);
  std::size_t number = 0;
  while (number < frames().size() && tracker.on_trial()) tracker.track(frames()[number++]);
  ASSERT_FALSE(tracker.on_trial());
  ASSERT_EQ(tracker.keyframes(), 5u);
  SequenceFrame wall = grey(frames()[0]);
  for (int lost = 0; lost < 8; ++lost) {
    wall.number = number++;
    EXPECT_EQ(tracker.track(wall).state, TrackState::lost);
  }
  EXPECT_EQ(tracker.keyframes(), 5u);
}

TEST_F(TrackerWithoutDepth, features_take_the_depth_of_points_beside_them) {
  Tracker tracker(calibration_, options_);
  for (const SequenceFrame& frame : frames()) {
    tracker.track(frame);
    if (tracker.keyframes() > 0) break;
  }
  const MapChange change = tracker.take_change();
  EXPECT_EQ(change.map_points.points.size(), tracker.map_points());
  const std::vector<std::uint32_t>& views = change.features.views;
  for (const std::uint32_t view : {0u, 1u}) {
    const auto count = static_cast<std::size_t>(std::ranges::count(views, view));
    EXPECT_GT(count, tracker.map_points()) << view;
    EXPECT_LE(count, static_cast<std::size_t>(options_.features));
  }
  EXPECT_EQ(change.features.points.size(), views.size());
}

namespace association {

using namespace tracking;

/// Four features with different descriptors; two of them are close to each other in the image.
Features four() {
  Features f;
  f.pixels = {{10, 10}, {50, 50}, {52, 50}, {90, 20}};
  f.depths.assign(4, 1);
  f.levels.assign(4, 0);
  f.strengths.assign(4, 1);
  f.descriptors = cv::Mat::zeros(4, 32, CV_8U);
  for (int i = 0; i < 4; ++i) f.descriptors.row(i).colRange(8 * i, 8 * i + 8).setTo(255);
  return f;
}

TEST(Association, by_place_and_descriptor) {
  const Features features = four();
  const FeatureGrid grid(features);
  std::vector<std::size_t> near;
  grid.within({50, 51}, 3, near);
  EXPECT_EQ(near, (std::vector<std::size_t>{1, 2}));
  const auto wanted = [&](Vec2 place, int descriptor, int level) {
    return Expected{place, 5, level, features.descriptors.row(descriptor)};
  };
  const std::vector<Expected> expected{wanted({51, 50}, 2, 0), wanted({51, 50}, 1, 0), wanted({10, 10}, 3, 0),
                                       wanted({90, 20}, 3, 5), wanted({10, 10}, 0, 0)};
  // No match where descriptors or levels differ too much.
  EXPECT_EQ(match_expected(expected, features, grid), (std::vector<int>{2, 1, -1, -1, 0}));
}

TEST(Association, a_feature_goes_to_the_nearest) {
  const Features features = four();
  Expected near{{10, 10}, 5, 0, features.descriptors.row(0).clone()},
      exact{{11, 10}, 5, 0, features.descriptors.row(0)};
  near.descriptor.at<std::uint8_t>(0, 31) = 0xff;
  const FeatureGrid grid(features);
  EXPECT_EQ(match_expected(std::vector{near, exact}, features, grid), (std::vector<int>{-1, 0}));
  EXPECT_EQ(match_expected(std::vector{exact, near}, features, grid), (std::vector<int>{0, -1}));
}

TEST(Association, by_descriptor_alone_must_be_clear) {
  const Features features = four();
  cv::Mat other = features.descriptors.clone();
  EXPECT_EQ(match_descriptors(features.descriptors, other), (std::vector<int>{0, 1, 2, 3}));
  other.row(0).copyTo(other.row(1));  // as close as the first, hence ambiguous
  const std::vector<int> matches = match_descriptors(features.descriptors, other);
  EXPECT_EQ(matches, (std::vector<int>{-1, -1, 2, 3}));
  EXPECT_EQ(match_descriptors(features.descriptors, cv::Mat()), std::vector<int>(4, -1));
}

TEST(Association, along_an_epipolar_line) {
  const Features features = four();
  Features other = four();
  for (Vec2& pixel : other.pixels) pixel.x() += 7;
  other.pixels[1].y() += 5;  // off its line
  Eigen::Matrix3d line_of;   // of a camera that moves to the left: lines are rows
  line_of << 0, 0, 0, 0, 0, -1, 0, 1, 0;
  const std::vector<std::uint8_t> all(4, 1), not_the_last{1, 1, 1, 0};
  EXPECT_EQ(match_along_lines(features, other, line_of, all, all), (std::vector<int>{0, -1, 2, 3}));
  EXPECT_EQ(match_along_lines(features, other, line_of, all, not_the_last), (std::vector<int>{0, -1, 2, -1}));
  EXPECT_EQ(match_along_lines(features, other, line_of, not_the_last, all), (std::vector<int>{0, -1, 2, -1}));
}

}  // namespace association
}  // namespace
}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
// The synthetic walk: its cameras, its depth and its noise.
#include "trainer/synth/synth_walk.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include <glm/geometric.hpp>

#include "support/temporary_folder.h"
#include "trainer/sequence/sequence.h"
#include "trainer/synth/synth_view.h"

namespace splatboost::test {
namespace {

SynthOptions short_walk(const std::filesystem::path& output, int frames) {
  SynthOptions options;
  options.output = output;
  options.scene = "walk";
  options.width = 80;
  options.height = 60;
  options.views = frames;
  options.samples = 1;
  return options;
}

SequenceOptions of(const std::filesystem::path& source) {
  SequenceOptions options;
  options.source = source;
  return options;
}

TEST(Walk, ends_where_it_began_and_goes_in_small_steps) {
  double nearest = 10, longest = 0;
  for (int i = 1; i < kWalkFrames; ++i) {
    longest = std::max(longest, glm::length(walk_pose(i, kWalkFrames).centre - walk_pose(i - 1, kWalkFrames).centre));
    if (i > kWalkFrames / 2) {
      nearest = std::min(nearest, glm::length(walk_pose(i, kWalkFrames).centre - walk_pose(10, kWalkFrames).centre));
    }
  }
  EXPECT_LT(longest, 0.08);
  EXPECT_LT(nearest, 0.25);
}

/// A frame's depth is that of the surface, up to the noise: a wrong pose, focal length or pixel centre would cause
/// errors of centimetres.
TEST(Walk, depth_and_poses_agree_with_the_room) {
  const TemporaryFolder folder;
  write_synthetic_scene(short_walk(folder / "walk", 3));
  const auto sequence = open_sequence(of(folder / "walk"));
  ASSERT_EQ(sequence->size(), 3u);
  const Calibration& c = sequence->calibration();
  const auto room = synthetic::make_room();
  double sum = 0, square = 0;
  std::size_t measured = 0, none = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const SequenceFrame frame = sequence->read(i);
    ASSERT_EQ(frame.problem, "");
    const glm::dmat4 pose = *sequence->truth(i);
    for (int y = 0; y < frame.height; ++y) {
      for (int x = 0; x < frame.width; ++x) {
        const double z = frame.depth[static_cast<std::size_t>(y * frame.width + x)];
        if (z == 0) {
          ++none;
          continue;
        }
        const glm::dvec3 to = glm::dmat3(pose) * glm::dvec3((x - c.cx) / c.fx, (y - c.cy) / c.fy, 1);
        const double length = glm::length(to);
        const double truth = room->probe({glm::dvec3(pose[3]), to / length}).distance / length;
        const double off = (z - truth) / depth_sigma(truth);
        sum += off;
        square += off * off;
        ++measured;
      }
    }
  }
  EXPECT_GT(measured, 10000u);
  EXPECT_GT(none, 100u);
  EXPECT_NEAR(sum / static_cast<double>(measured), 0, 0.05);
  EXPECT_NEAR(square / static_cast<double>(measured), 1, 0.05);
}

TEST(Walk, same_seed_same_bytes_and_no_frames_of_a_longer_one) {
  const TemporaryFolder folder;
  write_synthetic_scene(short_walk(folder / "a", 4));
  write_synthetic_scene(short_walk(folder / "a", 2));
  write_synthetic_scene(short_walk(folder / "b", 2));
  EXPECT_EQ(open_sequence(of(folder / "a"))->size(), 2u);
  for (const char* file : {"results/frame000001.png", "results/depth000001.png", "traj.txt", "cam_params.json"}) {
    EXPECT_EQ(read_file(folder / "a" / file), read_file(folder / "b" / file)) << file;
  }
}

}  // namespace
}  // namespace splatboost::test

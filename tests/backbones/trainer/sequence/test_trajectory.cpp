// SPDX-License-Identifier: Apache-2.0
// Trajectories against known values.
#include "trainer/sequence/trajectory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include <glm/gtc/quaternion.hpp>

#include "support/temporary_folder.h"
#include "trainer/support/input_error.h"

namespace splatboost::test {
namespace {

std::vector<glm::dvec3> helix(int count) {
  std::vector<glm::dvec3> points;
  for (int i = 0; i < count; ++i) points.emplace_back(std::cos(0.3 * i), std::sin(0.3 * i), 0.1 * i);
  return points;
}

std::vector<glm::dvec3> moved(const std::vector<glm::dvec3>& points, double scale) {
  const glm::dmat3 turn = glm::mat3_cast(glm::angleAxis(2.1, glm::normalize(glm::dvec3(1, -2, 0.5))));
  std::vector<glm::dvec3> result;
  for (const glm::dvec3& p : points) result.push_back(scale * (turn * p) + glm::dvec3(3, -1, 7));
  return result;
}

TEST(Trajectory, a_rigid_matrix_is_told_from_others) {
  glm::dmat4 pose = glm::mat4_cast(glm::angleAxis(2.1, glm::normalize(glm::dvec3(1, -2, 0.5))));
  pose[3] = {5, 6, 7, 1};
  EXPECT_TRUE(is_rigid(pose));
  glm::dmat4 rounded = pose;
  for (int column = 0; column < 3; ++column) rounded[column] = glm::round(1000.0 * pose[column]) / 1000.0;
  EXPECT_TRUE(is_rigid(rounded));
  EXPECT_FALSE(is_rigid(glm::dmat4(0.0)));
  EXPECT_FALSE(is_rigid(glm::transpose(pose))) << "column by column";
  glm::dmat4 larger = pose, mirrored = pose;
  larger[0] *= 1.1;
  mirrored[0] *= -1.0;
  EXPECT_FALSE(is_rigid(larger));
  EXPECT_FALSE(is_rigid(mirrored));
}

TEST(Alignment, finds_a_rigid_motion) {
  const Alignment found = align(helix(20), moved(helix(20), 1), false);
  EXPECT_NEAR(found.rmse, 0, 1e-12);
  EXPECT_NEAR(found.scale, 1, 1e-12);
}

TEST(Alignment, finds_a_scale_only_where_it_is_asked_to) {
  EXPECT_NEAR(align(helix(20), moved(helix(20), 2), true).rmse, 0, 1e-12);
  EXPECT_NEAR(align(helix(20), moved(helix(20), 2), true).scale, 2, 1e-12);
  EXPECT_GT(align(helix(20), moved(helix(20), 2), false).rmse, 0.5);
}

/// Points are displaced alternately to both sides along an axis on which nothing else moves: no alignment reduces this.
TEST(Alignment, error_is_the_root_of_the_mean_square) {
  std::vector<glm::dvec3> from, to;
  for (int i = 0; i < 4; ++i) {
    const double x = i < 2 ? -1 : 1, y = i % 2 == 0 ? -1 : 1;
    from.emplace_back(x, y, 0);
    to.emplace_back(x, y, x * y * 0.05);
  }
  EXPECT_NEAR(align(from, to, false).rmse, 0.05, 1e-9);
}

TEST(Alignment, of_few_points_is_a_shift) {
  const std::vector<glm::dvec3> from{{0, 0, 0}, {1, 0, 0}}, to{{0, 5, 0}, {0, 6, 0}};
  EXPECT_NEAR(align(from, to, false).rmse, std::sqrt(0.5), 1e-12);
  EXPECT_EQ(align({}, {}, false).rmse, 0);
}

TEST(Alignment, of_most_leaves_out_what_does_not_fit) {
  const std::vector<glm::dvec3> from = helix(40);
  std::vector<glm::dvec3> to = moved(from, 2);
  for (const std::size_t wrong : {3u, 17u, 18u, 31u, 39u})
    to[wrong] += glm::dvec3(9, -4.0 * static_cast<double>(wrong), 7);
  std::size_t used = 0;
  const Alignment found = align_most(from, to, &used);
  EXPECT_EQ(used, 35u);
  EXPECT_NEAR(found.scale, 2, 1e-12);
  EXPECT_NEAR(found.rmse, 0, 1e-12);
  EXPECT_GT(align(from, to, true).rmse, 1);
  EXPECT_EQ(align_most({}, {}, &used).rmse, 0);
  EXPECT_EQ(used, 0u);
}

TEST(Trajectory, positions_of_a_log_are_the_last_column) {
  const TemporaryFolder folder;
  const std::string pose = "0 0 0\n1 0 0 1.5\n0 0 -1 -2\n0 1 0 3e1\n0 0 0 1\n";
  std::ofstream(folder / "t.log") << pose << "1 1 0\r\n1 0 0 4\r\n0 1 0 5\r\n0 0 1 6\r\n0 0 0 1\r\n\n";
  const std::vector<glm::dvec3> read = read_log_positions(folder / "t.log");
  EXPECT_EQ(read, (std::vector<glm::dvec3>{{1.5, -2, 30}, {4, 5, 6}}));
  const auto message = [&](const std::string& text) {
    std::ofstream(folder / "t.log") << text;
    try {
      read_log_positions(folder / "t.log");
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(message(pose + "1 1 0\n1 0 0 x\n").find("t.log:7: expected four numbers"), std::string::npos);
  EXPECT_NE(message(pose + "1 1\n").find("t.log:6: expected the three numbers"), std::string::npos);
  EXPECT_NE(message(pose + "1 1 0\n1 0 0 4\n").find("ends within"), std::string::npos);
}

TEST(Trajectory, files_are_read_back) {
  const TemporaryFolder folder;
  std::vector<TimedPose> poses(2);
  poses[1].time = 1305031102.175304;
  poses[1].world_from_camera = glm::mat4_cast(glm::angleAxis(3.0, glm::normalize(glm::dvec3(1, 2, 3))));
  poses[1].world_from_camera[3] = {1, -2, 3.5, 1};
  write_tum_trajectory(folder / "t.txt", poses);
  const std::vector<TimedPose> read = read_tum_trajectory(folder / "t.txt");
  ASSERT_EQ(read.size(), 2u);
  EXPECT_NEAR(read[1].time, poses[1].time, 1e-5);
  for (int c = 0; c < 4; ++c) {
    for (int r = 0; r < 4; ++r) EXPECT_NEAR(read[1].world_from_camera[c][r], poses[1].world_from_camera[c][r], 1e-6);
  }
}

TEST(Trajectory, a_broken_line_is_named) {
  const TemporaryFolder folder;
  std::ofstream(folder / "t.txt") << "# times\n0 0 0 0 0 0 0 1\n1 0 0 zero\n";
  try {
    read_tum_trajectory(folder / "t.txt");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("t.txt:3"), std::string::npos) << error.what();
  }
}

TEST(Trajectory, times_are_paired_with_the_nearest) {
  const std::vector<double> times{0, 1.004, 2.03, 9}, others{0.01, 1.0, 1.006, 2.0};
  EXPECT_EQ(nearest_in_time(times, others, 0.02), (std::vector<std::ptrdiff_t>{0, 2, -1, -1}));
  EXPECT_EQ(nearest_in_time(times, {}, 0.02), (std::vector<std::ptrdiff_t>{-1, -1, -1, -1}));
}

TEST(Trajectory, length_of_a_path) {
  EXPECT_NEAR(path_length(std::vector<glm::dvec3>{{0, 0, 0}, {3, 4, 0}, {3, 4, 2}}), 7, 1e-12);
  EXPECT_EQ(path_length({}), 0);
}

}  // namespace
}  // namespace splatboost::test

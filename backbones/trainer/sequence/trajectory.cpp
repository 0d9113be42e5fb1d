// SPDX-License-Identifier: Apache-2.0
#include "trainer/sequence/trajectory.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include <Eigen/Geometry>
#include <glm/gtc/quaternion.hpp>

#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {

void write_tum_trajectory(const std::filesystem::path& path, std::span<const TimedPose> poses) {
  std::string text;
  for (const TimedPose& pose : poses) {
    const glm::dquat q = glm::normalize(glm::quat_cast(glm::dmat3(pose.world_from_camera)));
    const glm::dvec4 t = pose.world_from_camera[3];
    char line[256];
    std::snprintf(line, sizeof(line), "%.6f %.7f %.7f %.7f %.7f %.7f %.7f %.7f\n", pose.time, t.x, t.y, t.z, q.x, q.y,
                  q.z, q.w);
    text += line;
  }
  write_text_atomically(path, text);
}

std::vector<TimedPose> read_tum_trajectory(const std::filesystem::path& path) {
  std::ifstream file(path);
  require(file.good(), path.string() + ": cannot be read");
  std::vector<TimedPose> poses;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const std::size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    std::istringstream words(line);
    TimedPose pose;
    glm::dvec3 t;
    glm::dquat q;
    words >> pose.time >> t.x >> t.y >> t.z >> q.x >> q.y >> q.z >> q.w;
    const double length = glm::length(q);
    require(!words.fail() && std::isfinite(pose.time + t.x + t.y + t.z) && length > 1e-6 && std::isfinite(length),
            path.string() + ":" + std::to_string(number) + ": expected 'time tx ty tz qx qy qz qw'");
    pose.world_from_camera = glm::mat4_cast(glm::normalize(q));
    pose.world_from_camera[3] = glm::dvec4(t, 1);
    poses.push_back(pose);
  }
  return poses;
}

std::vector<std::ptrdiff_t> nearest_in_time(std::span<const double> times, std::span<const double> others,
                                            double most) {
  std::vector<std::ptrdiff_t> nearest;
  for (const double time : times) {
    const auto after = std::lower_bound(others.begin(), others.end(), time);
    std::ptrdiff_t best = -1;
    double distance = most;
    for (const auto at : {after == others.begin() ? others.end() : after - 1, after}) {
      if (at == others.end() || std::abs(*at - time) > distance) continue;
      best = at - others.begin();
      distance = std::abs(*at - time);
    }
    nearest.push_back(best);
  }
  return nearest;
}

Alignment align(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to, bool with_scale) {
  Alignment result;
  const auto n = static_cast<Eigen::Index>(std::min(from.size(), to.size()));
  if (n == 0) return result;
  Eigen::Matrix3Xd source(3, n), target(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const glm::dvec3 &a = from[static_cast<std::size_t>(i)], &b = to[static_cast<std::size_t>(i)];
    source.col(i) << a.x, a.y, a.z;
    target.col(i) << b.x, b.y, b.z;
  }
  Eigen::Matrix4d motion = Eigen::Matrix4d::Identity();
  const double spread = (source.colwise() - source.rowwise().mean()).squaredNorm();
  if (n < 3 || !(spread > 0)) {
    motion.topRightCorner<3, 1>() = target.rowwise().mean() - source.rowwise().mean();
  } else {
    motion = Eigen::umeyama(source, target, with_scale);
  }
  result.scale = std::cbrt(motion.topLeftCorner<3, 3>().determinant());
  const Eigen::Matrix3Xd left =
      target - ((motion.topLeftCorner<3, 3>() * source).colwise() + Eigen::Vector3d(motion.topRightCorner<3, 1>()));
  result.rmse = std::sqrt(left.squaredNorm() / static_cast<double>(n));
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 4; ++row) result.to_from[column][row] = motion(row, column);
  }
  return result;
}

double path_length(std::span<const glm::dvec3> positions) {
  double length = 0;
  for (std::size_t i = 1; i < positions.size(); ++i) length += glm::length(positions[i] - positions[i - 1]);
  return length;
}

}  // namespace splatboost

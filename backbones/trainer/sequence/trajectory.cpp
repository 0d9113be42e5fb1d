// SPDX-License-Identifier: Apache-2.0
#include "trainer/sequence/trajectory.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include <Eigen/Geometry>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr double kMaxRigidError = 1e-2;  ///< of R Rᵀ − I
constexpr double kRounding = 1e-6;       ///< of the extent: residuals below it are no outliers
constexpr double kOutlier = 3;           ///< medians of the residuals from which a pair is left out
constexpr int kOutlierRounds = 50;       ///< at most; the pairs left out settle before that

}  // namespace

bool is_rigid(const glm::dmat4& matrix) {
  const glm::dmat3 r(matrix), off = r * glm::transpose(r) - glm::dmat3(1.0);
  const double error = glm::length(off[0]) + glm::length(off[1]) + glm::length(off[2]);
  const double of_last_row = glm::length(glm::transpose(matrix)[3] - glm::dvec4(0, 0, 0, 1));
  return error + of_last_row < kMaxRigidError && glm::determinant(r) > 0;
}

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

std::vector<glm::dvec3> read_log_positions(const std::filesystem::path& path) {
  constexpr int kLines = 5;
  std::ifstream file(path);
  require(file.good(), path.string() + ": cannot be read");
  std::vector<glm::dvec3> positions;
  std::string line;
  int part = 0;  // of the camera: 0 the three numbers, then the rows
  for (int number = 1; std::getline(file, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    std::istringstream words(line);
    double values[4] = {};
    const int count = part == 0 ? 3 : 4;
    for (int i = 0; i < count; ++i) words >> values[i];
    require(!words.fail() && std::isfinite(values[0] + values[1] + values[2] + values[3]),
            path.string() + ":" + std::to_string(number) +
                (part == 0 ? ": expected the three numbers before a camera's matrix"
                           : ": expected four numbers, a row of a camera's matrix"));
    if (part == 1) positions.emplace_back();
    if (part >= 1 && part <= 3) positions.back()[part - 1] = values[3];
    part = (part + 1) % kLines;
  }
  require(part == 0, path.string() + ": ends within a camera's matrix");
  return positions;
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

Alignment align_most(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to, std::size_t* used) {
  std::vector<glm::dvec3> some_from(from.begin(), from.end()), some_to(to.begin(), to.end());
  double extent = 0;
  for (const glm::dvec3& position : to) extent = std::max(extent, glm::length(position - to.front()));
  Alignment found;
  std::vector<bool> fits(from.size(), true);
  for (int round = 0; round < kOutlierRounds; ++round) {
    found = align(some_from, some_to, true);
    std::vector<double> residuals;
    for (std::size_t i = 0; i < from.size(); ++i) {
      residuals.push_back(glm::length(glm::dvec3(found.to_from * glm::dvec4(from[i], 1)) - to[i]));
    }
    if (residuals.empty()) break;
    std::vector<double> sorted = residuals;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double limit = std::max(kOutlier * *middle, kRounding * extent);
    const std::vector<bool> before = fits;
    some_from.clear();
    some_to.clear();
    for (std::size_t i = 0; i < from.size(); ++i) {
      fits[i] = residuals[i] <= limit;
      if (!fits[i]) continue;
      some_from.push_back(from[i]);
      some_to.push_back(to[i]);
    }
    if (fits == before) break;
  }
  if (used != nullptr) *used = some_from.size();
  return found;
}

double path_length(std::span<const glm::dvec3> positions) {
  double length = 0;
  for (std::size_t i = 1; i < positions.size(); ++i) length += glm::length(positions[i] - positions[i - 1]);
  return length;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Trajectories: files in TUM and .log format, and the error against the ground truth.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>

namespace splatboost {

struct TimedPose {
  double time = 0;                    ///< s
  glm::dmat4 world_from_camera{1.0};  ///< rigid
};

/// Whether the matrix is a rotation, up to rounding to three decimals, and a translation.
bool is_rigid(const glm::dmat4& matrix);

/// Lines of "time tx ty tz qx qy qz qw". Atomic.
void write_tum_trajectory(const std::filesystem::path& path, std::span<const TimedPose> poses);

/// Reads such a file; lines that begin with # are skipped. Throws InputError naming the line.
std::vector<TimedPose> read_tum_trajectory(const std::filesystem::path& path);

/// Reads the camera positions of a .log file (Tanks and Temples): for each camera a line of three numbers, which are
/// not used, and the 4×4 matrix world from camera in four lines. Throws InputError naming the line.
std::vector<glm::dvec3> read_log_positions(const std::filesystem::path& path);

/// For each of `times`, the index of the nearest of `others` (ascending) at most `most` seconds away; -1: none.
std::vector<std::ptrdiff_t> nearest_in_time(std::span<const double> times, std::span<const double> others, double most);

/// The least-squares transform of `from` to `to` (Umeyama 1991), and its residual.
struct Alignment {
  glm::dmat4 to_from{1.0};  ///< scale · rotation and translation
  double scale = 1;
  double rmse = 0;  ///< of the residual distances: the absolute trajectory error (ATE)
};

/// @param from, to [N] corresponding positions; fewer than 3 do not determine a rotation: they are only translated
/// @param with_scale for a trajectory of unknown scale (one camera without depth)
Alignment align(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to, bool with_scale);

/// The same with scale, without pairs that do not fit: repeatedly, those with a residual above three times the median
/// are left out. At least half of the pairs must be right.
/// @param used if not null, receives the number of pairs that were used
Alignment align_most(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to, std::size_t* used = nullptr);

/// Sum of the distances from each position to the next.
double path_length(std::span<const glm::dvec3> positions);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file Alignment of a reconstruction by its cameras, the first step of the Tanks and Temples evaluation.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>

namespace splatboost::program {

struct TrajectoryAlignment {
  std::array<double, 16> transform{};  ///< similarity from the model to the trajectory, row-major
  double scale = 1;
  double rmse = 0;          ///< of the camera positions, in units of the trajectory
  std::size_t cameras = 0;  ///< that determined it
  std::size_t left_out = 0;
};

/// The similarity (Umeyama 1991) from the cameras of a model to the poses of a trajectory. Cameras that do not fit the
/// others are left out, because both reconstructions may have wrong poses.
/// @param cameras a cameras.json, the model folder with it, or a COLMAP model or scene
/// @param trajectory .log file with a pose for each image. If the model has fewer cameras, the last number in the name
/// of each is the number of its image, from 1.
/// Throws InputError if the cameras cannot be matched or do not determine the similarity.
TrajectoryAlignment align_to_trajectory(const std::filesystem::path& cameras, const std::filesystem::path& trajectory);

}  // namespace splatboost::program

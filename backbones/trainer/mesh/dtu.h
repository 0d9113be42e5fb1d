// SPDX-License-Identifier: Apache-2.0
/// @file DTU's evaluation of a reconstruction (Jensen et al. 2014; Aanæs et al. 2016): what of it the scanner observed,
/// and what of the scan stands on the table. Lengths are millimetres of DTU's frame.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

namespace splatboost {

inline constexpr double kDtuSpacing = 0.2;  ///< points of a reconstruction are thinned to it
inline constexpr double kDtuCut = 20;       ///< pairs farther apart are outliers, and left out of the means

/// Where the scanner observed the space: a grid of points, of which each stands for what is nearest to it.
struct DtuMask {
  std::array<double, 3> low{}, high{};  ///< the grid's box
  double resolution = 0;                ///< between grid points
  std::array<std::size_t, 3> size{};    ///< grid points along x, y and z
  std::vector<std::uint8_t> observed;   ///< [z,y,x]: x runs fastest
};

/// Reads ObsMask, BB and Res of ObsMaskN_10.mat. Throws InputError.
DtuMask read_dtu_mask(const std::filesystem::path& path);

/// Reads P of PlaneN.mat: what is above the table has P·(x, y, z, 1) > 0. Throws InputError.
std::array<double, 4> read_dtu_plane(const std::filesystem::path& path);

/// The points [N,3] within the mask's box, or not far from it (60 mm below and 120 mm above, as DTU's evaluation has
/// been used): those that the scan is compared with.
std::vector<float> near_mask(std::span<const float> points, const DtuMask& mask);
/// The points whose grid point was observed: those that are compared with the scan.
std::vector<float> observed(std::span<const float> points, const DtuMask& mask);
std::vector<float> above_plane(std::span<const float> points, const std::array<double, 4>& plane);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file DTU's evaluation of a reconstruction (Jensen et al. 2014; Aanæs et al. 2016): which part of it the scanner
/// observed, and which part of the scan lies above the table. Lengths are in millimetres, in DTU's frame.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

namespace splatboost {

inline constexpr double kDtuSpacing = 0.2;  ///< distance to which the points of a reconstruction are thinned
inline constexpr double kDtuCut = 20;       ///< pairs farther apart are outliers, excluded from the means

/// Which part of space the scanner observed: a grid of points, each standing for the space nearest to it.
struct DtuMask {
  std::array<double, 3> low{}, high{};  ///< the grid's box
  double resolution = 0;                ///< distance between grid points
  std::array<std::size_t, 3> size{};    ///< grid points along x, y and z
  std::vector<std::uint8_t> observed;   ///< [z,y,x]: x runs fastest
};

/// Reads ObsMask, BB and Res of ObsMaskN_10.mat. Throws InputError.
DtuMask read_dtu_mask(const std::filesystem::path& path);

/// Reads P of PlaneN.mat: points above the table have P·(x, y, z, 1) > 0. Throws InputError.
std::array<double, 4> read_dtu_plane(const std::filesystem::path& path);

/// The points [N,3] within the mask's box extended by 60 mm at its lower and 120 mm at its upper faces, as in earlier
/// uses of DTU's evaluation: the scan is compared with these.
std::vector<float> near_mask(std::span<const float> points, const DtuMask& mask);
/// The points whose nearest grid point was observed: these are compared with the scan.
std::vector<float> observed(std::span<const float> points, const DtuMask& mask);
std::vector<float> above_plane(std::span<const float> points, const std::array<double, 4>& plane);

}  // namespace splatboost

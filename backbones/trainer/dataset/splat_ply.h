// SPDX-License-Identifier: Apache-2.0
/// @file Reads and writes the standard 3DGS .ply.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "trainer/dataset/scene.h"

namespace splatboost {

/// Raw (not activated) parameters, as 3DGS stores them. Shapes as in Gaussians.
struct SplatCloud {
  std::vector<float> means;            ///< [N,3]
  std::vector<float> sh_dc;            ///< [N,3]
  std::vector<float> sh_rest;          ///< [N,rest,3]; channel-major in the file, as in 3DGS
  int sh_rest_rows = 0;                ///< 0, 3, 8 or 15
  std::vector<float> logit_opacities;  ///< [N]
  std::vector<float> log_scales;       ///< [N,3]
  std::vector<float> rotations;        ///< [N,4] w,x,y,z
  std::vector<float> filters;          ///< [N] standard deviation of Mip-Splatting's 3D filter; empty: no filter
  std::size_t size() const { return logit_opacities.size(); }
};

/// Binary little endian, properties x y z nx ny nz f_dc_* f_rest_* opacity scale_* rot_*, and filter_3D if there are
/// filters. Written atomically. Throws std::runtime_error, and writes nothing, if a number is not finite.
void write_splat_ply(const std::filesystem::path& path, const SplatCloud& cloud);

/// Reads what write_splat_ply and other 3DGS programs write (binary or ascii, properties in any order). Throws
/// InputError on anything missing or truncated.
SplatCloud read_splat_ply(const std::filesystem::path& path);

/// Reads x y z and, if present, red green blue (else mid grey) of a .ply. Throws InputError likewise.
PointCloud read_point_ply(const std::filesystem::path& path);

/// Throws InputError if the file exists and is a model in a .ply, of Gaussians or other primitives. For outputs that
/// the user names.
void require_no_model(const std::filesystem::path& output);

/// Writes x y z nx ny nz (normals of 0, which readers of 3DGS hosts require) and red green blue as bytes, atomically.
/// Throws std::runtime_error if a number is not finite.
void write_point_ply(const std::filesystem::path& path, const PointCloud& cloud);

/// Rows of named 32-bit floats: vertices of layouts other than 3DGS's.
struct FloatTable {
  std::vector<std::string> names;
  std::vector<float> values;  ///< [rows, names.size()]
  std::size_t rows() const { return names.empty() ? 0 : values.size() / names.size(); }
};

/// Binary little endian, written atomically. Throws std::runtime_error if a number is not finite.
void write_float_ply(const std::filesystem::path& path, const FloatTable& table);

/// Reads the named properties, in that order. Throws InputError if one is missing, and as read_splat_ply() does.
FloatTable read_float_ply(const std::filesystem::path& path, std::vector<std::string> names);

}  // namespace splatboost

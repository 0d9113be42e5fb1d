// SPDX-License-Identifier: Apache-2.0
/// @file Triangle meshes with colours and opacities, and their files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace splatboost {

struct TriangleMesh {
  std::vector<float> positions;          ///< [V,3] world
  std::vector<std::uint8_t> colors;      ///< [V,3]; empty: none
  std::vector<std::uint8_t> opacities;   ///< [V]; only with colours; empty: opaque
  std::vector<std::uint32_t> triangles;  ///< [T,3] counter-clockwise as seen from outside
  std::size_t vertices() const { return positions.size() / 3; }
  std::size_t size() const { return triangles.size() / 3; }
};

/// Keeps the largest of the connected parts that have at least `least_triangles` triangles.
/// @param most number of parts to keep; 0: all of them
/// @return number of connected parts before
std::size_t keep_largest_parts(TriangleMesh& mesh, std::size_t least_triangles, std::size_t most);

/// Writes a .ply (binary little endian) or .glb (glTF 2.0; positions as in the world, not turned to glTF's y up;
/// colours unlit; with opacities, alpha blended and double-sided), by the file's extension. Written to a temporary
/// file, then renamed. Throws InputError on another extension, and if the mesh is too large for a .glb, whose lengths
/// have 32 bits.
void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh);

/// Reads a .ply of triangles or of points only, binary little endian or text; colours and other properties are ignored.
/// Polygons are split into triangle fans. Throws InputError on anything missing or truncated.
TriangleMesh read_mesh(const std::filesystem::path& path);

}  // namespace splatboost

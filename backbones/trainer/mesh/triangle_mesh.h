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

/// Leaves the connected parts of at least so many triangles, and of these the largest.
/// @param most how many; 0: all of them
/// @return how many parts there were
std::size_t keep_largest_parts(TriangleMesh& mesh, std::size_t least_triangles, std::size_t most);

/// By the file's ending: .ply (binary little endian) or .glb (glTF 2.0, y up as the world has it; with opacities
/// blended and seen from both sides). Written aside, then renamed. Throws InputError on another ending, and where a
/// .glb, whose lengths have 32 bits, cannot hold the mesh.
void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh);

/// Reads a .ply of triangles or points (then without triangles), binary little endian or text; colours and other
/// properties are not read. Polygons become fans. Throws InputError on anything missing or truncated.
TriangleMesh read_mesh(const std::filesystem::path& path);

}  // namespace splatboost

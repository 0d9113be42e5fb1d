// SPDX-License-Identifier: Apache-2.0
/// @file Convexes as triangles, for viewers that know nothing of them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "convex_splatting/convex_file.h"

namespace splatboost {

/// Triangles with colours and opacities, each convex apart from the others.
struct ConvexMesh {
  std::vector<float> positions;          ///< [V,3] world
  std::vector<std::uint8_t> colors;      ///< [V,4] red, green, blue, opacity
  std::vector<std::uint32_t> triangles;  ///< [T,3] counter-clockwise as seen from outside
};

/// The hulls of the convexes that are drawn, in the colour of their degree-0 spherical harmonics. They are sharp: how
/// soft a convex is, and what it shows from other sides, is lost.
ConvexMesh convex_mesh(const ConvexCloud& cloud);

/// By the file's ending: .ply (binary little endian) or .glb (glTF 2.0, blended by opacity, seen from both sides).
/// Written aside, then renamed. Throws InputError on another ending.
void write_convex_mesh(const std::filesystem::path& path, const ConvexMesh& mesh);

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file A picture of a mesh, shaded by its normals.
#pragma once

#include <cstdint>
#include <vector>

#include "splatboost/camera.h"
#include "trainer/mesh/triangle_mesh.h"

namespace splatboost {

/// Each pixel shows the nearest triangle at its centre, white where it faces the camera and darker the more it is
/// turned away, the same from both sides; black where there is none. Triangles that reach behind the camera are left
/// out.
/// @return [H,W] grey, of the camera's size
std::vector<std::uint8_t> draw_mesh(const TriangleMesh& mesh, const Camera& camera);

}  // namespace splatboost

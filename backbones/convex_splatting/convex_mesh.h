// SPDX-License-Identifier: Apache-2.0
/// @file Convexes as triangle meshes, for viewers that do not support convexes.
#pragma once

#include "convex_splatting/convex_file.h"
#include "trainer/mesh/triangle_mesh.h"

namespace splatboost {

/// The hulls of the rendered convexes, with opacities and the colours of their degree-0 spherical harmonics.
/// Smoothness, sharpness and view-dependent colour are lost. Throws InputError if no convex is rendered.
TriangleMesh convex_mesh(const ConvexCloud& cloud);

}  // namespace splatboost

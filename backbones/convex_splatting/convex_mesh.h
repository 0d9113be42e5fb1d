// SPDX-License-Identifier: Apache-2.0
/// @file Convexes as triangles, for viewers that know nothing of them.
#pragma once

#include "convex_splatting/convex_file.h"
#include "trainer/mesh/triangle_mesh.h"

namespace splatboost {

/// The hulls of the convexes that are drawn, in the colour of their degree-0 spherical harmonics. They are sharp: how
/// soft a convex is, and what it shows from other sides, is lost.
TriangleMesh convex_mesh(const ConvexCloud& cloud);

}  // namespace splatboost

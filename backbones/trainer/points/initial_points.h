// SPDX-License-Identifier: Apache-2.0
/// @file Random initial points, for datasets that have none.
#pragma once

#include <cstdint>
#include <vector>

#include <glm/vec3.hpp>

#include "trainer/dataset/scene.h"

namespace splatboost {

/// A cube of initial points.
struct PointBox {
  glm::dvec3 centre{0.0};
  double half = 0;  ///< half of its side
};

/// As in 3DGS: the objects of NeRF-synthetic fit into it.
PointBox synthetic_box();

/// The box that the cameras look at. Its centre is the point nearest to all optical axes or, if the axes are almost
/// parallel, a point in front of the cameras; its half side is the distance to the farthest camera.
PointBox look_at_box(const std::vector<View>& views);

/// Throws InputError if no initial point lies in the picture of a training view, so that nothing can be learned.
void require_visible_points(const Scene& scene);

/// Grey points, drawn evenly from the box.
PointCloud random_points(const PointBox& box, int count, std::uint64_t seed);

}  // namespace splatboost

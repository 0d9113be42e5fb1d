// SPDX-License-Identifier: Apache-2.0
/// @file Distortion of a lens by the model of Brown and Conrady, as COLMAP and OpenCV define it.
#pragma once

#include <glm/vec2.hpp>

namespace splatboost {

struct BrownConrady {
  double k1 = 0, k2 = 0, k3 = 0;  ///< radial
  double p1 = 0, p2 = 0;          ///< tangential

  bool is_identity() const { return k1 == 0 && k2 == 0 && k3 == 0 && p1 == 0 && p2 == 0; }

  /// Where the lens shows a point of the plane z = 1, on that plane.
  glm::dvec2 distort(const glm::dvec2& point) const;

  /// The largest radius on the plane z = 1, at most `largest`, up to which the distorted radius increases. Beyond it
  /// the model folds the image back over itself and is invalid.
  double fold_radius(double largest) const;
};

}  // namespace splatboost

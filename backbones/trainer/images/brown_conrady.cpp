// SPDX-License-Identifier: Apache-2.0
#include "trainer/images/brown_conrady.h"

#include <glm/geometric.hpp>

namespace splatboost {

glm::dvec2 BrownConrady::distort(const glm::dvec2& point) const {
  const double x = point.x, y = point.y;
  const double r2 = glm::dot(point, point);
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
}

double BrownConrady::fold_radius(double largest) const {
  constexpr int kSteps = 2048;
  for (int i = 1; i <= kSteps; ++i) {
    const double r = largest * i / kSteps;
    const double r2 = r * r;
    if (1 + r2 * (3 * k1 + r2 * (5 * k2 + r2 * 7 * k3)) <= 0) return largest * (i - 1) / kSteps;
  }
  return largest;
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
/// @file The point nearest to several lines, by linear least squares.
#pragma once

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <glm/vec3.hpp>

namespace splatboost {

/// Minimises Σ wᵢ |p − lineᵢ|²: Σ wᵢ (I − dᵢ dᵢᵀ)(p − oᵢ) = 0.
class NearestToLines {
 public:
  /// @param direction of length 1
  void add(const glm::dvec3& origin, const glm::dvec3& direction, double weight = 1) {
    const glm::dmat3 across = weight * (glm::dmat3(1.0) - glm::outerProduct(direction, direction));
    normal_ += across;
    right_ += across * origin;
    weight_ += weight;
  }
  /// How well the lines determine the point: 0 if they are parallel, at most 8/27. 0 without lines.
  double condition() const { return weight_ > 0 ? glm::determinant(normal_ / weight_) : 0; }
  /// Requires that condition() is above 0.
  glm::dvec3 point() const { return glm::inverse(normal_) * right_; }

 private:
  glm::dmat3 normal_{0.0};
  glm::dvec3 right_{0.0};
  double weight_ = 0;
};

}  // namespace splatboost

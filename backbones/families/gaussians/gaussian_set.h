// SPDX-License-Identifier: Apache-2.0
/// @file Insertion and motion of Gaussians outside of density control, for mappers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>

#include "trainer/dataset/scene.h"

namespace splatboost {

/// x → scale · rotation · x + translation
struct Similarity {
  glm::dmat3 rotation{1.0};
  glm::dvec3 translation{0.0};
  double scale = 1;
};

/// Passed to GaussianMethod::edit(). All data is in host memory. Gaussians keep their indices until growth or pruning;
/// inserted ones are appended.
class GaussianSet {
 public:
  virtual std::size_t size() const = 0;
  /// [N,3], a copy
  virtual std::vector<float> means() const = 0;
  /// Appends Gaussians initialised from points as at the start of a run: isotropic, sized by the distance between the
  /// new points, with the initial opacity. Keeps the density statistics of the other Gaussians. If the cap does not
  /// admit all points, an even subset is used. New rows of the method's groups are zero.
  /// @return indices of the points used, in the order of the new Gaussians
  virtual std::vector<std::uint32_t> insert(const PointCloud& points) = 0;
  /// Moves Gaussian i by transforms[which[i]]; -1: unchanged. Resets the Adam moments of positions and rotations and
  /// the statistics of density control. Spherical harmonics are not rotated.
  /// @param which [N]
  virtual void transform(std::span<const std::int32_t> which, std::span<const Similarity> transforms) = 0;

 protected:
  ~GaussianSet() = default;
};

}  // namespace splatboost

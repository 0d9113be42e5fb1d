// SPDX-License-Identifier: Apache-2.0
/// @file The Gaussians of a run as a mapper changes them: what comes and moves from outside of density control.
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

/// A GaussianMethod gets it in edit(). Everything is in memory of the host. Gaussians keep their places until growth or
/// removal; those inserted come last.
class GaussianSet {
 public:
  virtual std::size_t size() const = 0;
  /// [N,3], a copy
  virtual std::vector<float> means() const = 0;
  /// Appends Gaussians as a run's start makes them of points: isotropic, as large as the new points are apart, of the
  /// initial opacity. What density control has gathered of the others stays. Of more points than the cap has room for
  /// an even subset is taken. The rows of the method's groups are zeros.
  /// @return which of the points were taken, in the order of the new Gaussians
  virtual std::vector<std::uint32_t> insert(const PointCloud& points) = 0;
  /// Moves Gaussian i by transforms[which[i]]; -1: it stays. Moments of positions and rotations begin anew, and so do
  /// the statistics of density control. Colours are not turned.
  /// @param which [N]
  virtual void transform(std::span<const std::int32_t> which, std::span<const Similarity> transforms) = 0;

 protected:
  ~GaussianSet() = default;
};

}  // namespace splatboost

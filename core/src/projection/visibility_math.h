// SPDX-License-Identifier: Apache-2.0
/// @file Visibility of one Gaussian in a view, without rendering it.

#if defined(SPLATBOOST_VISIBILITY_MATH_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_VISIBILITY_MATH_H_
#undef SPLATBOOST_VISIBILITY_MATH_H_
#else
#define SPLATBOOST_VISIBILITY_MATH_H_
#endif

#include <cstddef>
#include <cstdint>
#include <limits>

#include "device/host_device.h"
#include "projection/project_math.h"
#include "projection/tile_math.h"

SPLATBOOST_MATH_BEGIN

/// Depth of a mean in the camera frame.
SPLATBOOST_HOST_DEVICE float depth_of(const ProjectionCamera& camera, Vec3<float> mean) {
  return dot(widen<float>(camera.axis_z), mean) + camera.translation[2];
}

/// Covariance of Gaussian i, from covariances [N,6], or from scales [N,3] and rotations [N,4] if those are empty.
template <class Floats>
SPLATBOOST_HOST_DEVICE Symmetric3<float> covariance_at(const Floats& scales, const Floats& rotations,
                                                       const Floats& covariances, std::size_t i) {
  if (!covariances.empty()) {
    return {covariances[6 * i],     covariances[6 * i + 1], covariances[6 * i + 2],
            covariances[6 * i + 3], covariances[6 * i + 4], covariances[6 * i + 5]};
  }
  const Quaternion<float> q{rotations[4 * i], rotations[4 * i + 1], rotations[4 * i + 2], rotations[4 * i + 3]};
  const float inverse_length = 1.0f / sqrt_of(dot(q, q));
  // With NaN, no radius is visible.
  const float unit = is_normalisable(inverse_length) ? inverse_length : std::numeric_limits<float>::quiet_NaN();
  return covariance_of(Vec3<float>{scales[3 * i], scales[3 * i + 1], scales[3 * i + 2]}, rotation_of(unit * q));
}

/// Radius in px of the 3σ square, rounded up; 0 where it meets no tile of the image.
SPLATBOOST_HOST_DEVICE std::int32_t visible_radius(const ProjectionCamera& camera, Vec3<float> mean,
                                                   const Symmetric3<float>& covariance, float low_pass,
                                                   float near_plane, int tiles_x, int tiles_y) {
  const Projection<float> p = project_gaussian(camera, mean, covariance, low_pass, false, near_plane);
  const float radius = square_radius(p.covariance);
  const TileRange<float> x = square_tiles(p.mean.x, radius, tiles_x);
  const TileRange<float> y = square_tiles(p.mean.y, radius, tiles_y);
  const bool seen = p.valid && x.begin < x.end && y.begin < y.end;
  return seen ? static_cast<std::int32_t>(min_of(radius, 1e9f)) : 0;
}

SPLATBOOST_MATH_END

#endif  // guard

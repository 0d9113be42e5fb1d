// SPDX-License-Identifier: Apache-2.0
#include "splatboost/visibility.h"

#include <cmath>

#include <hwy/highway.h>  // for the namespace that the formulas live in; plain floats here

#include "project_math.h"
#include "projection_camera.h"
#include "splatboost/errors.h"
#include "tile_math.h"

namespace splatboost {
namespace {

namespace math = HWY_NAMESPACE;
constexpr std::size_t kGrain = 2048;

void check_near_plane(float near_plane) {
  SPLATBOOST_CHECK(near_plane > 0.0f && std::isfinite(near_plane), "near_plane must be finite and above 0");
}

math::Symmetric3<float> covariance_at(const Gaussians& gaussians, std::size_t i) {
  if (!gaussians.covariances.empty()) {
    const float* c = &gaussians.covariances[6 * i];
    return {c[0], c[1], c[2], c[3], c[4], c[5]};
  }
  const float* s = &gaussians.scales[3 * i];
  const float* q = &gaussians.rotations[4 * i];
  const float inverse_length = 1.0f / std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const math::Quaternion<float> unit{q[0] * inverse_length, q[1] * inverse_length, q[2] * inverse_length,
                                     q[3] * inverse_length};
  return math::covariance_of(math::Vec3<float>{s[0], s[1], s[2]}, math::rotation_of(unit));
}

}  // namespace

void mark_visible(const Camera& camera, std::span<const float> means, float near_plane, std::span<std::uint8_t> visible,
                  Threads& threads) {
  check_camera(camera);
  check_near_plane(near_plane);
  SPLATBOOST_CHECK(means.size() == 3 * visible.size(), "means must be [N,3], visible [N]");
  const glm::mat4& view = camera.camera_from_world;
  threads.for_range(visible.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const float* m = &means[3 * i];
      visible[i] = view[0][2] * m[0] + view[1][2] * m[1] + view[2][2] * m[2] + view[3][2] > near_plane ? 1 : 0;
    }
  });
}

void visible_radii(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
                   std::span<std::int32_t> radii, Threads& threads) {
  check_camera(camera);
  check_near_plane(options.near_plane);
  SPLATBOOST_CHECK(options.low_pass >= 0.0f && std::isfinite(options.low_pass),
                   "low_pass must be finite and not negative");
  const std::size_t n = gaussians.count;
  SPLATBOOST_CHECK(radii.size() == n && gaussians.means.size() == 3 * n, "means must be [N,3], radii [N]");
  SPLATBOOST_CHECK(gaussians.covariances.empty()
                       ? gaussians.scales.size() == 3 * n && gaussians.rotations.size() == 4 * n
                       : gaussians.covariances.size() == 6 * n,
                   "scales must be [N,3] and rotations [N,4], or covariances [N,6]");
  const ProjectionCamera projection = make_projection_camera(camera);
  const int tiles_x = camera.tiles_x(), tiles_y = camera.tiles_y();
  threads.for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const float* m = &gaussians.means[3 * i];
      const math::Projection<float> p =
          math::project_gaussian(projection, math::Vec3<float>{m[0], m[1], m[2]}, covariance_at(gaussians, i),
                                 options.low_pass, false, options.near_plane);
      const float radius = math::square_radius(p.covariance);
      const math::TileRange<float> x = math::square_tiles(p.mean.x, radius, tiles_x);
      const math::TileRange<float> y = math::square_tiles(p.mean.y, radius, tiles_y);
      const bool seen = p.valid && x.begin < x.end && y.begin < y.end;
      radii[i] = seen ? static_cast<std::int32_t>(min_of(radius, 1e9f)) : 0;
    }
  });
}

}  // namespace splatboost

// SPDX-License-Identifier: Apache-2.0
#include "splatboost/visibility.h"

#include <cmath>

#include <hwy/highway.h>  // for the namespace of the formulas, which are used with plain floats here

#include "projection/cuda_ops.h"
#include "projection/projection_camera.h"
#include "projection/visibility_math.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

namespace math = HWY_NAMESPACE;
constexpr std::size_t kGrain = 2048;

void check_near_plane(float near_plane) {
  SPLATBOOST_CHECK(near_plane > 0.0f && std::isfinite(near_plane), "near_plane must be finite and above 0");
}

}  // namespace

void mark_visible(const Camera& camera, std::span<const float> means, float near_plane, std::span<std::uint8_t> visible,
                  Device device) {
  check_camera(camera);
  check_near_plane(near_plane);
  SPLATBOOST_CHECK(means.size() == 3 * visible.size(), "means must be [N,3], visible [N]");
  if (device.is_cuda()) return cuda::mark_visible(camera, means, near_plane, visible, device.stream());
  const ProjectionCamera projection = make_projection_camera(camera);
  device.threads().for_range(visible.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const float* m = &means[3 * i];
      visible[i] = math::depth_of(projection, math::Vec3<float>{m[0], m[1], m[2]}) > near_plane ? 1 : 0;
    }
  });
}

void visible_radii(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
                   std::span<std::int32_t> radii, Device device) {
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
  if (device.is_cuda()) return cuda::visible_radii(camera, gaussians, options, radii, device.stream());
  const ProjectionCamera projection = make_projection_camera(camera);
  const int tiles_x = camera.tiles_x(), tiles_y = camera.tiles_y();
  device.threads().for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const float* m = &gaussians.means[3 * i];
      radii[i] =
          math::visible_radius(projection, math::Vec3<float>{m[0], m[1], m[2]},
                               math::covariance_at(gaussians.scales, gaussians.rotations, gaussians.covariances, i),
                               options.low_pass, options.near_plane, tiles_x, tiles_y);
    }
  });
}

}  // namespace splatboost

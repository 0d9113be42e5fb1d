// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "projection/cuda_ops.h"
#include "projection/visibility_math.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    mark_visible_kernel(ProjectionCamera camera, DeviceView<const float> means, float near_plane,
                        DeviceView<std::uint8_t> visible) {
  const std::size_t i = element_index();
  if (i >= visible.size()) return;
  visible[i] = depth_of(camera, Vec3<float>{means[3 * i], means[3 * i + 1], means[3 * i + 2]}) > near_plane ? 1 : 0;
}

__global__ void __launch_bounds__(kBlockThreads)
    visible_radii_kernel(ProjectionCamera camera, DeviceView<const float> means, DeviceView<const float> scales,
                         DeviceView<const float> rotations, DeviceView<const float> covariances, float low_pass,
                         float near_plane, int tiles_x, int tiles_y, DeviceView<std::int32_t> radii) {
  const std::size_t i = element_index();
  if (i >= radii.size()) return;
  radii[i] = visible_radius(camera, Vec3<float>{means[3 * i], means[3 * i + 1], means[3 * i + 2]},
                            covariance_at(scales, rotations, covariances, i), low_pass, near_plane, tiles_x, tiles_y);
}

}  // namespace

void mark_visible(const Camera& camera, std::span<const float> means, float near_plane, std::span<std::uint8_t> visible,
                  CudaStream& stream) {
  launch_each(stream, "mark_visible", mark_visible_kernel, visible.size(), make_projection_camera(camera), means,
              near_plane, visible);
}

void visible_radii(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
                   std::span<std::int32_t> radii, CudaStream& stream) {
  launch_each(stream, "visible_radii", visible_radii_kernel, radii.size(), make_projection_camera(camera),
              gaussians.means, gaussians.scales, gaussians.rotations, gaussians.covariances, options.low_pass,
              options.near_plane, camera.tiles_x(), camera.tiles_y(), radii);
}

}  // namespace splatboost::cuda

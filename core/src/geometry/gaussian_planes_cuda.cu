// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "geometry/cuda_ops.h"
#include "geometry/plane_math.h"
#include "geometry/surface_math.h"

namespace splatboost::cuda {
namespace {

/// The plane of Gaussian i.
__device__ PlaneOf<float> plane_at(DeviceView<const float> means, DeviceView<const float> scales,
                                   DeviceView<const float> rotations, const ProjectionCamera& camera, std::size_t i) {
  const float own[3] = {scales[3 * i], scales[3 * i + 1], scales[3 * i + 2]};
  return plane_of(Vec3<float>{means[3 * i], means[3 * i + 1], means[3 * i + 2]}, own,
                  Quaternion<float>{rotations[4 * i], rotations[4 * i + 1], rotations[4 * i + 2], rotations[4 * i + 3]},
                  camera);
}

__global__ void __launch_bounds__(kBlockThreads)
    planes_kernel(DeviceView<const float> means, DeviceView<const float> scales, DeviceView<const float> rotations,
                  ProjectionCamera camera, DeviceView<float> planes) {
  const std::size_t i = element_index();
  if (4 * i >= planes.size()) return;
  const GaussianPlane<float> plane = in_camera(plane_at(means, scales, rotations, camera, i), camera);
  planes[4 * i] = plane.normal.x;
  planes[4 * i + 1] = plane.normal.y;
  planes[4 * i + 2] = plane.normal.z;
  planes[4 * i + 3] = plane.distance;
}

__global__ void __launch_bounds__(kBlockThreads)
    planes_backward_kernel(DeviceView<const float> means, DeviceView<const float> scales,
                           DeviceView<const float> rotations, ProjectionCamera camera,
                           DeviceView<const float> gradients, DeviceView<float> g_means,
                           DeviceView<float> g_rotations) {
  const std::size_t i = element_index();
  if (4 * i >= gradients.size()) return;
  const GaussianPlane<float> g{{gradients[4 * i], gradients[4 * i + 1], gradients[4 * i + 2]}, gradients[4 * i + 3]};
  if (g.normal.x == 0 && g.normal.y == 0 && g.normal.z == 0 && g.distance == 0) return;  // most are not visible
  Vec3<float> mean;
  Quaternion<float> rotation;
  plane_gradients(plane_at(means, scales, rotations, camera, i), camera, g, mean, rotation);
  g_means[3 * i] += mean.x;
  g_means[3 * i + 1] += mean.y;
  g_means[3 * i + 2] += mean.z;
  g_rotations[4 * i] += rotation.w;
  g_rotations[4 * i + 1] += rotation.x;
  g_rotations[4 * i + 2] += rotation.y;
  g_rotations[4 * i + 3] += rotation.z;
}

__device__ inline std::size_t shortest_of(DeviceView<const float> scales, std::size_t i) {
  const float own[3] = {scales[3 * i], scales[3 * i + 1], scales[3 * i + 2]};
  return 3 * i + static_cast<std::size_t>(surface::shortest_axis<float>(own));
}

__global__ void __launch_bounds__(kBlockThreads)
    flatness_sums_kernel(DeviceView<const float> scales, DeviceView<const std::uint8_t> visible,
                         DeviceView<double> sums) {
  const std::size_t i = element_index();
  const bool seen = i < visible.size() && visible[i] != 0;
  const float scale = warp_sum(seen ? scales[shortest_of(scales, i)] : 0.0f), count = warp_sum(seen ? 1.0f : 0.0f);
  if (threadIdx.x % 32 != 0 || count == 0) return;
  atomicAdd(&sums[0], static_cast<double>(scale));
  atomicAdd(&sums[1], static_cast<double>(count));
}

__global__ void flatness_mean_kernel(float weight, DeviceView<double> sums) {
  if (sums[1] > 0) sums[0] *= static_cast<double>(weight) / sums[1];
}

__global__ void __launch_bounds__(kBlockThreads)
    flatness_backward_kernel(DeviceView<const float> scales, DeviceView<const std::uint8_t> visible, float weight,
                             DeviceView<const double> sums, DeviceView<float> gradients) {
  const std::size_t i = element_index();
  if (i >= visible.size() || visible[i] == 0) return;
  gradients[shortest_of(scales, i)] += weight / static_cast<float>(sums[1]);
}

}  // namespace

void gaussian_planes(const Gaussians& gaussians, const Camera& camera, std::span<float> planes, CudaStream& stream) {
  launch_each(stream, "gaussian_planes", planes_kernel, gaussians.count, gaussians.means, gaussians.scales,
              gaussians.rotations, make_projection_camera(camera), planes);
}

void gaussian_planes_backward(const Gaussians& gaussians, const Camera& camera, std::span<const float> plane_gradients,
                              std::span<float> means, std::span<float> rotations, CudaStream& stream) {
  launch_each(stream, "gaussian_planes_backward", planes_backward_kernel, gaussians.count, gaussians.means,
              gaussians.scales, gaussians.rotations, make_projection_camera(camera), plane_gradients, means, rotations);
}

void flatness_loss(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                   std::span<double> sums, CudaStream& stream) {
  stream.fill_zero(sums.data(), sums.size_bytes());
  launch_each(stream, "flatness_sums", flatness_sums_kernel, visible.size(), scales, visible, sums);
  launch(stream, "flatness_mean", flatness_mean_kernel, dim3(1), dim3(1), weight, sums);
}

void flatness_loss_backward(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                            std::span<const double> sums, std::span<float> gradients, CudaStream& stream) {
  launch_each(stream, "flatness_backward", flatness_backward_kernel, visible.size(), scales, visible, weight, sums,
              gradients);
}

}  // namespace splatboost::cuda

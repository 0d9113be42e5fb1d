// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "geometry/cuda_ops.h"
#include "geometry/surface_math.h"

namespace splatboost::cuda {
namespace {

using surface::Motion;
using surface::Plane;
using surface::PlaneOf;

/// The numbers of Gaussian i, where the formulas read them.
struct GaussianRow {
  float mean[3], scales[3], rotation[4];
  __device__ GaussianRow(DeviceView<const float> means, DeviceView<const float> all_scales,
                         DeviceView<const float> rotations, std::size_t i) {
    for (std::size_t c = 0; c < 3; ++c) {
      mean[c] = means[3 * i + c];
      scales[c] = all_scales[3 * i + c];
    }
    for (std::size_t c = 0; c < 4; ++c) rotation[c] = rotations[4 * i + c];
  }
};

__global__ void __launch_bounds__(kBlockThreads)
    planes_kernel(DeviceView<const float> means, DeviceView<const float> scales, DeviceView<const float> rotations,
                  Motion<float> camera_from_world, DeviceView<float> planes) {
  const std::size_t i = element_index();
  if (4 * i >= planes.size()) return;
  const GaussianRow row(means, scales, rotations, i);
  const Plane<float> plane =
      PlaneOf<float>(row.mean, row.scales, row.rotation, camera_from_world).plane(camera_from_world);
  planes[4 * i] = plane.normal.x;
  planes[4 * i + 1] = plane.normal.y;
  planes[4 * i + 2] = plane.normal.z;
  planes[4 * i + 3] = plane.distance;
}

__global__ void __launch_bounds__(kBlockThreads)
    planes_backward_kernel(DeviceView<const float> means, DeviceView<const float> scales,
                           DeviceView<const float> rotations, Motion<float> camera_from_world,
                           DeviceView<const float> plane_gradients, DeviceView<float> g_means,
                           DeviceView<float> g_rotations) {
  const std::size_t i = element_index();
  if (4 * i >= plane_gradients.size()) return;
  const Plane<float> g{{plane_gradients[4 * i], plane_gradients[4 * i + 1], plane_gradients[4 * i + 2]},
                       plane_gradients[4 * i + 3]};
  if (g.normal.x == 0 && g.normal.y == 0 && g.normal.z == 0 && g.distance == 0) return;  // most are not seen
  const GaussianRow row(means, scales, rotations, i);
  float g_mean[3] = {0, 0, 0}, g_rotation[4] = {0, 0, 0, 0};
  PlaneOf<float>(row.mean, row.scales, row.rotation, camera_from_world)
      .backward(camera_from_world, g, g_mean, g_rotation);
  for (std::size_t c = 0; c < 3; ++c) g_means[3 * i + c] += g_mean[c];
  for (std::size_t c = 0; c < 4; ++c) g_rotations[4 * i + c] += g_rotation[c];
}

__global__ void __launch_bounds__(kBlockThreads)
    count_visible_kernel(DeviceView<const std::uint8_t> visible, DeviceView<double> workspace) {
  const std::size_t i = element_index();
  const float seen = warp_sum(i < visible.size() && visible[i] != 0 ? 1.0f : 0.0f);
  if (threadIdx.x % 32 == 0 && seen > 0) atomicAdd(&workspace[1], static_cast<double>(seen));
}

__global__ void __launch_bounds__(kBlockThreads)
    flatness_kernel(DeviceView<const float> scales, DeviceView<const std::uint8_t> visible, float weight,
                    DeviceView<float> gradients, DeviceView<double> workspace) {
  const std::size_t i = element_index();
  float term = 0;
  if (i < visible.size() && visible[i] != 0) {
    const float share = weight / static_cast<float>(workspace[1]);
    const float own[3] = {scales[3 * i], scales[3 * i + 1], scales[3 * i + 2]};
    const std::size_t at = 3 * i + static_cast<std::size_t>(surface::shortest_axis<float>(own));
    term = share * scales[at];
    gradients[at] += share;
  }
  const float sum = warp_sum(term);
  if (threadIdx.x % 32 == 0 && sum > 0) atomicAdd(&workspace[0], static_cast<double>(sum));
}

}  // namespace

void gaussian_planes(const Gaussians& gaussians, const Camera& camera, std::span<float> planes, CudaStream& stream) {
  launch_each(stream, "gaussian_planes", planes_kernel, gaussians.count, gaussians.means, gaussians.scales,
              gaussians.rotations, surface::camera_from_world_of<float>(camera), planes);
}

void gaussian_planes_backward(const Gaussians& gaussians, const Camera& camera, std::span<const float> plane_gradients,
                              std::span<float> means, std::span<float> rotations, CudaStream& stream) {
  launch_each(stream, "gaussian_planes_backward", planes_backward_kernel, gaussians.count, gaussians.means,
              gaussians.scales, gaussians.rotations, surface::camera_from_world_of<float>(camera), plane_gradients,
              means, rotations);
}

void add_flatness_gradients(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                            std::span<float> gradients, std::span<double> workspace, CudaStream& stream) {
  stream.fill_zero(workspace.data(), workspace.size_bytes());
  launch_each(stream, "count_visible", count_visible_kernel, visible.size(), visible, workspace);
  launch_each(stream, "flatness", flatness_kernel, visible.size(), scales, visible, weight, gradients, workspace);
}

}  // namespace splatboost::cuda

// SPDX-License-Identifier: Apache-2.0
#include "splatboost/gaussian_planes.h"

#include "geometry/cuda_ops.h"
#include "geometry/surface_math.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 1024;

void check_plane_gaussians(const Gaussians& g) {
  SPLATBOOST_CHECK(g.means.size() == 3 * g.count && g.scales.size() == 3 * g.count && g.rotations.size() == 4 * g.count,
                   "planes need the means, scales and rotations of all Gaussians");
}

}  // namespace

void gaussian_planes(const Gaussians& gaussians, const Camera& camera, std::span<float> planes, Device device) {
  check_plane_gaussians(gaussians);
  SPLATBOOST_CHECK(planes.size() == kPlaneChannels * gaussians.count, "planes must be [N,4]");
  if (device.is_cuda()) return cuda::gaussian_planes(gaussians, camera, planes, device.stream());
  const auto motion = surface::camera_from_world_of<float>(camera);
  device.threads().for_range(gaussians.count, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const surface::PlaneOf<float> of(&gaussians.means[3 * i], &gaussians.scales[3 * i], &gaussians.rotations[4 * i],
                                       motion);
      const surface::Plane<float> plane = of.plane(motion);
      planes[4 * i] = plane.normal.x;
      planes[4 * i + 1] = plane.normal.y;
      planes[4 * i + 2] = plane.normal.z;
      planes[4 * i + 3] = plane.distance;
    }
  });
}

void gaussian_planes_backward(const Gaussians& gaussians, const Camera& camera, std::span<const float> plane_gradients,
                              std::span<float> means, std::span<float> rotations, Device device) {
  check_plane_gaussians(gaussians);
  SPLATBOOST_CHECK(plane_gradients.size() == kPlaneChannels * gaussians.count &&
                       means.size() == gaussians.means.size() && rotations.size() == gaussians.rotations.size(),
                   "gradients must have N rows");
  if (device.is_cuda()) {
    return cuda::gaussian_planes_backward(gaussians, camera, plane_gradients, means, rotations, device.stream());
  }
  const auto motion = surface::camera_from_world_of<float>(camera);
  device.threads().for_range(gaussians.count, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const float* g = &plane_gradients[4 * i];
      if (g[0] == 0 && g[1] == 0 && g[2] == 0 && g[3] == 0) continue;  // most are not visible
      const surface::PlaneOf<float> of(&gaussians.means[3 * i], &gaussians.scales[3 * i], &gaussians.rotations[4 * i],
                                       motion);
      of.backward(motion, {{g[0], g[1], g[2]}, g[3]}, &means[3 * i], &rotations[4 * i]);
    }
  });
}

void flatness_loss(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                   std::span<double> sums, Device device) {
  SPLATBOOST_CHECK(scales.size() == 3 * visible.size() && sums.size() == 2,
                   "scales must be [N,3] and visible [N], the sums two numbers");
  if (device.is_cuda()) return cuda::flatness_loss(scales, visible, weight, sums, device.stream());
  double sum = 0, seen = 0;
  for (std::size_t i = 0; i < visible.size(); ++i) {
    if (visible[i] == 0) continue;
    sum += static_cast<double>(scales[3 * i + static_cast<std::size_t>(surface::shortest_axis(&scales[3 * i]))]);
    seen += 1;
  }
  sums[0] = seen > 0 ? static_cast<double>(weight) * sum / seen : 0.0;
  sums[1] = seen;
}

void flatness_loss_backward(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                            std::span<const double> sums, std::span<float> gradients, Device device) {
  SPLATBOOST_CHECK(scales.size() == 3 * visible.size() && gradients.size() == scales.size() && sums.size() == 2,
                   "scales and gradients must be [N,3] and visible [N], the sums two numbers");
  if (device.is_cuda()) {
    return cuda::flatness_loss_backward(scales, visible, weight, sums, gradients, device.stream());
  }
  if (sums[1] == 0) return;
  const float share = weight / static_cast<float>(sums[1]);
  for (std::size_t i = 0; i < visible.size(); ++i) {
    if (visible[i] != 0) gradients[3 * i + static_cast<std::size_t>(surface::shortest_axis(&scales[3 * i]))] += share;
  }
}

}  // namespace splatboost

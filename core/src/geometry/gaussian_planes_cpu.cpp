// SPDX-License-Identifier: Apache-2.0
#include "splatboost/gaussian_planes.h"

#include <algorithm>

#include "geometry/cuda_ops.h"
#include "geometry/surface_math.h"
#include "splatboost/errors.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "geometry/gaussian_planes_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "device/lanes-inl.h"
#include "geometry/plane_math.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// The planes of the Gaussians from `i` on, one per lane. Lanes from `count` on repeat the last.
PlaneOf<Float> planes_at(const Gaussians& gaussians, const ProjectionCamera& camera, std::size_t i, std::size_t count) {
  Float mean[3], scales[3], rotation[4];
  load_rows(&gaussians.means[3 * i], count, mean);
  load_rows(&gaussians.scales[3 * i], count, scales);
  load_rows(&gaussians.rotations[4 * i], count, rotation);
  return plane_of(Vec3<Float>{mean[0], mean[1], mean[2]}, scales,
                  Quaternion<Float>{rotation[0], rotation[1], rotation[2], rotation[3]}, camera);
}

void planes_of_range(const Gaussians& gaussians, const ProjectionCamera& camera, std::size_t begin, std::size_t end,
                     std::span<float> planes) {
  for (std::size_t i = begin; i < end; i += lanes()) {
    const std::size_t count = std::min(lanes(), end - i);
    const GaussianPlane<Float> plane = in_camera(planes_at(gaussians, camera, i, count), camera);
    const Float columns[4] = {plane.normal.x, plane.normal.y, plane.normal.z, plane.distance};
    store_rows(columns, count, false, &planes[4 * i]);
  }
}

void planes_backward_of_range(const Gaussians& gaussians, const ProjectionCamera& camera, std::size_t begin,
                              std::size_t end, std::span<const float> plane_gradients_of, std::span<float> means,
                              std::span<float> rotations) {
  const Float zero(0.0f);
  for (std::size_t i = begin; i < end; i += lanes()) {
    const std::size_t count = std::min(lanes(), end - i);
    Float g[4];
    load_rows(&plane_gradients_of[4 * i], count, g);
    const Bool unseen = zero >= abs_of(g[0]) + abs_of(g[1]) + abs_of(g[2]) + abs_of(g[3]);
    if (hn::AllTrue(Lanes(), unseen.m)) continue;
    Vec3<Float> mean;
    Quaternion<Float> rotation;
    plane_gradients(planes_at(gaussians, camera, i, count), camera, GaussianPlane<Float>{{g[0], g[1], g[2]}, g[3]},
                    mean, rotation);
    // A Gaussian that cannot be drawn has no plane, but NaN.
    const Float of_mean[3] = {select(unseen, zero, mean.x), select(unseen, zero, mean.y), select(unseen, zero, mean.z)};
    const Float of_rotation[4] = {select(unseen, zero, rotation.w), select(unseen, zero, rotation.x),
                                  select(unseen, zero, rotation.y), select(unseen, zero, rotation.z)};
    store_rows(of_mean, count, true, &means[3 * i]);
    store_rows(of_rotation, count, true, &rotations[4 * i]);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
HWY_EXPORT(planes_of_range);
HWY_EXPORT(planes_backward_of_range);

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
  const ProjectionCamera projection = make_projection_camera(camera);
  device.threads().for_range(gaussians.count, kGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(planes_of_range)(gaussians, projection, begin, end, planes);
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
  const ProjectionCamera projection = make_projection_camera(camera);
  device.threads().for_range(gaussians.count, kGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(planes_backward_of_range)
    (gaussians, projection, begin, end, plane_gradients, means, rotations);
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
#endif  // HWY_ONCE

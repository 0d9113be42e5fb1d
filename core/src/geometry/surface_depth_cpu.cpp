// SPDX-License-Identifier: Apache-2.0
#include "splatboost/surface_depth.h"

#include "geometry/cuda_ops.h"
#include "geometry/surface_math.h"
#include "splatboost/errors.h"
#include "splatboost/gaussian_planes.h"

namespace splatboost {
namespace {

constexpr std::size_t kRows = 8;  // per piece of work

std::size_t pixels_of(const Camera& camera) {
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

/// Calls body(x, y, pixel) for all pixels.
template <class Body>
void for_pixels(const Camera& camera, const Threads& threads, const Body& body) {
  const auto width = static_cast<std::size_t>(camera.width);
  threads.for_range(static_cast<std::size_t>(camera.height), kRows, [&](std::size_t begin, std::size_t end) {
    for (std::size_t y = begin; y < end; ++y) {
      for (std::size_t x = 0; x < width; ++x) body(static_cast<int>(x), static_cast<int>(y), y * width + x);
    }
  });
}

surface::Plane<float> plane_at(std::span<const float> planes, std::size_t p, std::size_t pixels) {
  return {{planes[p], planes[pixels + p], planes[2 * pixels + p]}, planes[3 * pixels + p]};
}

}  // namespace

void plane_depth(const Camera& camera, std::span<const float> planes, std::span<float> depth, Device device) {
  const std::size_t pixels = pixels_of(camera);
  SPLATBOOST_CHECK(planes.size() == kPlaneChannels * pixels && depth.size() == pixels,
                   "planes must be [4,H,W] and depth [H,W] of the camera");
  if (device.is_cuda()) return cuda::plane_depth(camera, planes, depth, device.stream());
  const auto pinhole = surface::pinhole_of<float>(camera);
  for_pixels(camera, device.threads(), [&](int x, int y, std::size_t p) {
    depth[p] = surface::depth_of(plane_at(planes, p, pixels),
                                 pinhole.ray(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f));
  });
}

void plane_depth_backward(const Camera& camera, std::span<const float> planes, std::span<const float> depth_gradients,
                          std::span<float> plane_gradients, Device device) {
  const std::size_t pixels = pixels_of(camera);
  SPLATBOOST_CHECK(planes.size() == kPlaneChannels * pixels && plane_gradients.size() == planes.size() &&
                       depth_gradients.size() == pixels,
                   "planes must be [4,H,W] and depth [H,W] of the camera");
  if (device.is_cuda()) {
    return cuda::plane_depth_backward(camera, planes, depth_gradients, plane_gradients, device.stream());
  }
  const auto pinhole = surface::pinhole_of<float>(camera);
  for_pixels(camera, device.threads(), [&](int x, int y, std::size_t p) {
    if (depth_gradients[p] == 0) return;
    const surface::Plane<float> g = surface::depth_backward(
        plane_at(planes, p, pixels), pinhole.ray(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f),
        depth_gradients[p]);
    plane_gradients[p] += g.normal.x;
    plane_gradients[pixels + p] += g.normal.y;
    plane_gradients[2 * pixels + p] += g.normal.z;
    plane_gradients[3 * pixels + p] += g.distance;
  });
}

void depth_normals(const Camera& camera, std::span<const float> depth, std::span<float> normals, Device device) {
  const std::size_t pixels = pixels_of(camera);
  SPLATBOOST_CHECK(depth.size() == pixels && normals.size() == 3 * pixels,
                   "depth must be [H,W] and normals [3,H,W] of the camera");
  if (device.is_cuda()) return cuda::depth_normals(camera, depth, normals, device.stream());
  const auto pinhole = surface::pinhole_of<float>(camera);
  for_pixels(camera, device.threads(), [&](int x, int y, std::size_t p) {
    const surface::Vector<float> normal = surface::normal_of_depth(pinhole, depth, x, y).normal;
    normals[p] = normal.x;
    normals[pixels + p] = normal.y;
    normals[2 * pixels + p] = normal.z;
  });
}

}  // namespace splatboost

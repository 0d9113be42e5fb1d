// SPDX-License-Identifier: Apache-2.0
#include "geometry/cuda_ops.h"
#include "geometry/pixels_cuda.h"

namespace splatboost::cuda {
namespace {

using surface::Pinhole;

__global__ void __launch_bounds__(kBlockThreads)
    plane_depth_kernel(Pinhole<float> pinhole, DeviceView<const float> planes, DeviceView<float> depth) {
  const ImagePixel pixel(pinhole.width, pinhole.height);
  if (!pixel.inside) return;
  depth[pixel.index] = surface::depth_of(pixel.plane(planes), pixel.ray(pinhole));
}

__global__ void __launch_bounds__(kBlockThreads)
    plane_depth_backward_kernel(Pinhole<float> pinhole, DeviceView<const float> planes,
                                DeviceView<const float> depth_gradients, DeviceView<float> plane_gradients) {
  const ImagePixel pixel(pinhole.width, pinhole.height);
  if (!pixel.inside || depth_gradients[pixel.index] == 0) return;
  const surface::Plane<float> g =
      surface::depth_backward(pixel.plane(planes), pixel.ray(pinhole), depth_gradients[pixel.index]);
  plane_gradients[pixel.index] += g.normal.x;
  plane_gradients[pixel.pixels + pixel.index] += g.normal.y;
  plane_gradients[2 * pixel.pixels + pixel.index] += g.normal.z;
  plane_gradients[3 * pixel.pixels + pixel.index] += g.distance;
}

__global__ void __launch_bounds__(kBlockThreads)
    depth_normals_kernel(Pinhole<float> pinhole, DeviceView<const float> depth, DeviceView<float> normals) {
  const ImagePixel pixel(pinhole.width, pinhole.height);
  if (!pixel.inside) return;
  const surface::Vector<float> normal = surface::normal_of_depth(pinhole, depth, pixel.x, pixel.y).normal;
  normals[pixel.index] = normal.x;
  normals[pixel.pixels + pixel.index] = normal.y;
  normals[2 * pixel.pixels + pixel.index] = normal.z;
}

}  // namespace

void plane_depth(const Camera& camera, std::span<const float> planes, std::span<float> depth, CudaStream& stream) {
  launch_each(stream, "plane_depth", plane_depth_kernel, depth.size(), surface::pinhole_of<float>(camera), planes,
              depth);
}

void plane_depth_backward(const Camera& camera, std::span<const float> planes, std::span<const float> depth_gradients,
                          std::span<float> plane_gradients, CudaStream& stream) {
  launch_each(stream, "plane_depth_backward", plane_depth_backward_kernel, depth_gradients.size(),
              surface::pinhole_of<float>(camera), planes, depth_gradients, plane_gradients);
}

void depth_normals(const Camera& camera, std::span<const float> depth, std::span<float> normals, CudaStream& stream) {
  launch_each(stream, "depth_normals", depth_normals_kernel, depth.size(), surface::pinhole_of<float>(camera), depth,
              normals);
}

}  // namespace splatboost::cuda

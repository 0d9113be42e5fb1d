// SPDX-License-Identifier: Apache-2.0
/// @file A thread's pixel of an image, for kernels with one thread per pixel. For .cu files.
#pragma once

#include "device/device_view.h"
#include "device/launch.h"
#include "geometry/surface_math.h"

namespace splatboost::cuda {

struct ImagePixel {
  std::size_t index, pixels;  ///< of the pixel in a plane; number of pixels of the image
  int x, y;
  bool inside;

  __device__ ImagePixel(int width, int height) {
    index = element_index();
    pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    inside = index < pixels;
    x = static_cast<int>(index % static_cast<std::size_t>(width));
    y = static_cast<int>(index / static_cast<std::size_t>(width));
  }
  __device__ surface::Vector<float> ray(const surface::Pinhole<float>& pinhole) const {
    return pinhole.ray(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
  }
  /// @param planes [4,H,W]
  __device__ surface::Plane<float> plane(const DeviceView<const float>& planes) const {
    return {{planes[index], planes[pixels + index], planes[2 * pixels + index]}, planes[3 * pixels + index]};
  }
};

/// Adds the sum of `value` over a warp's lanes to sums[which]. All lanes must call it.
__device__ inline void add_to_sum(DeviceView<double> sums, std::size_t which, float value) {
  const float sum = warp_sum(value);
  if (threadIdx.x % 32 == 0 && sum != 0) atomicAdd(&sums[which], static_cast<double>(sum));
}

}  // namespace splatboost::cuda

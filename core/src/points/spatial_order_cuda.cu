// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "device/run_cub.h"
#include "points/cuda_ops.h"
#include "points/spatial_order_math.h"
#include "splatboost/device_array.h"

namespace splatboost::cuda {
namespace {

/// Maps a float to an integer of the same order, so that integer atomics find the minimum and the maximum.
__device__ unsigned ordered_bits(float value) {
  const unsigned bits = __float_as_uint(value);
  return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}
__device__ float from_ordered_bits(unsigned ordered) {
  return __uint_as_float((ordered & 0x80000000u) != 0 ? ordered & 0x7fffffffu : ~ordered);
}

/// Initialises the bounds. @param bounds ordered bits: three minima, three maxima
__global__ void begin_kernel(DeviceView<unsigned> bounds) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    bounds[axis] = 0xffffffffu;
    bounds[3 + axis] = 0;
  }
}

__global__ void __launch_bounds__(kBlockThreads)
    bounds_kernel(DeviceView<const float> means, DeviceView<unsigned> bounds) {
  const std::size_t i = element_index();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    unsigned low = 0xffffffffu, high = 0;
    if (3 * i < means.size() && means[3 * i + axis] - means[3 * i + axis] == 0) {
      low = high = ordered_bits(means[3 * i + axis]);
    }
    for (int step = 16; step > 0; step /= 2) {
      const unsigned other_low = __shfl_xor_sync(0xffffffffu, low, step);
      const unsigned other_high = __shfl_xor_sync(0xffffffffu, high, step);
      low = other_low < low ? other_low : low;
      high = other_high > high ? other_high : high;
    }
    if (threadIdx.x % 32 != 0) continue;
    atomicMin(&bounds[axis], low);
    atomicMax(&bounds[3 + axis], high);
  }
}

__global__ void __launch_bounds__(kBlockThreads)
    codes_kernel(DeviceView<const float> means, DeviceView<const unsigned> bounds, DeviceView<std::uint64_t> codes,
                 DeviceView<std::uint32_t> points) {
  const std::size_t i = element_index();
  if (i >= codes.size()) return;
  float low[3];
  double extent = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    low[axis] = from_ordered_bits(bounds[axis]);
    const double side = static_cast<double>(from_ordered_bits(bounds[3 + axis])) - static_cast<double>(low[axis]);
    extent = side > extent ? side : extent;  // without finite points a side is NaN and is ignored
  }
  const float point[3] = {means[3 * i], means[3 * i + 1], means[3 * i + 2]};
  codes[i] = morton_code(point, low, extent);
  points[i] = static_cast<std::uint32_t>(i);
}

}  // namespace

void spatial_order(std::span<const float> means, std::span<std::uint32_t> order, CudaStream& stream) {
  const std::size_t n = order.size();
  if (n == 0) return;
  DeviceArray<unsigned> bounds(stream);
  DeviceArray<std::uint64_t> codes(stream), sorted_codes(stream);
  DeviceArray<std::uint32_t> points(stream);
  bounds.ensure(6);
  codes.ensure(n);
  sorted_codes.ensure(n);
  points.ensure(n);
  launch(stream, "spatial_begin", begin_kernel, dim3(1), dim3(1), bounds.span());
  launch_each(stream, "spatial_bounds", bounds_kernel, n, means, bounds.span());
  launch_each(stream, "spatial_codes", codes_kernel, n, means, std::span<const unsigned>(bounds.span()), codes.span(),
              points.span());
  DeviceArray<std::uint8_t> scratch(stream);
  run_cub(stream, scratch, "cub::SortPairs by place", [&](void* memory, std::size_t& bytes) {  // stable: ties by index
    return cub::DeviceRadixSort::SortPairs(memory, bytes, codes.data(), sorted_codes.data(), points.data(),
                                           order.data(), static_cast<std::int64_t>(n), 0, 64, handle_of(stream));
  });
}

}  // namespace splatboost::cuda

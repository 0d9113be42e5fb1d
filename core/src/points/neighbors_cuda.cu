// SPDX-License-Identifier: Apache-2.0
// Points are sorted along a Morton curve, so that points close in space are mostly close in the order. Each run of
// kBoxPoints points has a bounding box; a point searches the boxes that are nearer than its k-th neighbour so far.
#include "device/device_view.h"
#include "device/launch.h"
#include "points/cuda_ops.h"
#include "splatboost/device_array.h"

namespace splatboost::cuda {
namespace {

constexpr std::size_t kBoxPoints = 256;
constexpr float kFar = 3.402823466e38f;

/// Rounds as the search on the CPU does, so that both agree to the last bit.
__device__ float squared_distance(const float* a, DeviceView<const float> points, std::size_t b) {
  float sum = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float difference = __fadd_rn(a[axis], -points[3 * b + axis]);
    sum = __fadd_rn(sum, __fmul_rn(difference, difference));
  }
  return sum;
}

__global__ void __launch_bounds__(kBlockThreads)
    sorted_points_kernel(DeviceView<const float> points, DeviceView<const std::uint32_t> order,
                         DeviceView<float> sorted) {
  const std::size_t i = element_index();
  if (i >= order.size()) return;
  for (std::size_t axis = 0; axis < 3; ++axis) sorted[3 * i + axis] = points[std::size_t{3} * order[i] + axis];
}

/// Bounding boxes. @param boxes [boxes,6] lowest and highest corner
__global__ void __launch_bounds__(kBlockThreads) boxes_kernel(DeviceView<const float> sorted, DeviceView<float> boxes) {
  const std::size_t box = element_index();
  if (6 * box >= boxes.size()) return;
  const std::size_t n = sorted.size() / 3, begin = box * kBoxPoints;
  const std::size_t end = begin + kBoxPoints < n ? begin + kBoxPoints : n;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    float low = sorted[3 * begin + axis], high = low;
    for (std::size_t i = begin + 1; i < end; ++i) {
      low = fminf(low, sorted[3 * i + axis]);
      high = fmaxf(high, sorted[3 * i + axis]);
    }
    boxes[6 * box + axis] = low;
    boxes[6 * box + 3 + axis] = high;
  }
}

/// The smallest squared distances so far, ascending.
struct Nearest {
  float squared[kMaxNeighbors];
  int k, found;

  __device__ float farthest() const { return found < k ? kFar : squared[k - 1]; }
  __device__ void insert(float value) {
    if (found == k && !(value < squared[k - 1])) return;
    int place = found < k ? found++ : k - 1;
    for (; place > 0 && squared[place - 1] > value; --place) squared[place] = squared[place - 1];
    squared[place] = value;
  }
};

__global__ void __launch_bounds__(kBlockThreads)
    neighbors_kernel(DeviceView<const float> sorted, DeviceView<const std::uint32_t> order,
                     DeviceView<const float> boxes, int k, DeviceView<float> mean_squared_distances) {
  const std::size_t i = element_index(), n = order.size();
  if (i >= n) return;
  const float point[3] = {sorted[3 * i], sorted[3 * i + 1], sorted[3 * i + 2]};
  Nearest nearest{{}, k, 0};
  const std::size_t own = i / kBoxPoints, count = boxes.size() / 6;
  const auto look_into = [&](std::size_t box) {
    const std::size_t begin = box * kBoxPoints, end = begin + kBoxPoints < n ? begin + kBoxPoints : n;
    for (std::size_t other = begin; other < end; ++other) {
      if (other != i) nearest.insert(squared_distance(point, sorted, other));
    }
  };
  look_into(own);
  for (std::size_t box = 0; box < count; ++box) {
    if (box == own) continue;
    float away = 0;  // rounded like the distances, so never above that of a point in the box
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float low = boxes[6 * box + axis], high = boxes[6 * box + 3 + axis];
      const float beyond = point[axis] < low    ? __fadd_rn(point[axis], -low)
                           : point[axis] > high ? __fadd_rn(point[axis], -high)
                                                : 0.0f;
      away = __fadd_rn(away, __fmul_rn(beyond, beyond));
    }
    if (away < nearest.farthest()) look_into(box);
  }
  float sum = 0;
  for (int j = 0; j < nearest.found; ++j) sum += nearest.squared[j];
  mean_squared_distances[order[i]] = nearest.found > 0 ? sum / static_cast<float>(nearest.found) : 0.0f;
}

}  // namespace

void mean_squared_neighbor_distances(std::span<const float> points, int k, std::span<float> mean_squared_distances,
                                     CudaStream& stream) {
  const std::size_t n = mean_squared_distances.size();
  DeviceArray<std::uint32_t> order(stream);
  DeviceArray<float> sorted(stream), boxes(stream);
  order.ensure(n);
  sorted.ensure(3 * n);
  boxes.ensure((n + kBoxPoints - 1) / kBoxPoints * 6);
  spatial_order(points, order.span(), stream);
  launch_each(stream, "sorted_points", sorted_points_kernel, n, points, std::span<const std::uint32_t>(order.span()),
              sorted.span());
  launch_each(stream, "boxes", boxes_kernel, boxes.size() / 6, std::span<const float>(sorted.span()), boxes.span());
  launch_each(stream, "neighbors", neighbors_kernel, n, std::span<const float>(sorted.span()),
              std::span<const std::uint32_t>(order.span()), std::span<const float>(boxes.span()), k,
              mean_squared_distances);
}

}  // namespace splatboost::cuda

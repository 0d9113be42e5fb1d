// SPDX-License-Identifier: Apache-2.0
#include "density/cuda_ops.h"
#include "device/device_view.h"
#include "device/launch.h"
#include "splatboost/device_array.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    add_view_kernel(DeviceView<const std::int32_t> view_counts, double loss, DeviceView<std::int64_t> counts,
                    DeviceView<double> weighted_counts) {
  const std::size_t i = element_index();
  if (i >= counts.size()) return;
  counts[i] += view_counts[i];
  // Rounded twice, as on the CPU: a fused multiply-add would give different sums and decisions.
  if (i < weighted_counts.size()) {
    weighted_counts[i] = __dadd_rn(weighted_counts[i], __dmul_rn(loss, static_cast<double>(view_counts[i])));
  }
}

__global__ void __launch_bounds__(kBlockThreads)
    importance_kernel(DeviceView<const std::int64_t> counts, std::int64_t views, DeviceView<std::int64_t> scores) {
  const std::size_t i = element_index();
  if (i < scores.size()) scores[i] = views > 0 ? counts[i] / views : 0;
}

/// Finds the smallest and the largest value. Launched with one block, whatever N.
__global__ void __launch_bounds__(kBlockThreads)
    range_kernel(DeviceView<const double> values, DeviceView<double> low_and_high) {
  __shared__ SharedArray<double, kBlockThreads> lows, highs;
  const int thread = static_cast<int>(threadIdx.x);
  double low = values[0], high = values[0];
  for (std::size_t i = threadIdx.x; i < values.size(); i += kBlockThreads) {
    low = values[i] < low ? values[i] : low;
    high = values[i] > high ? values[i] : high;
  }
  lows.set(thread, low);
  highs.set(thread, high);
  __syncthreads();
  for (int step = static_cast<int>(kBlockThreads) / 2; step > 0; step /= 2) {
    if (thread < step) {
      const double other_low = lows.get(thread + step), other_high = highs.get(thread + step);
      low = other_low < low ? other_low : low;
      high = other_high > high ? other_high : high;
    }
    __syncthreads();
    lows.set(thread, low);
    highs.set(thread, high);
    __syncthreads();
  }
  if (thread == 0) {
    low_and_high[0] = low;
    low_and_high[1] = high;
  }
}

__global__ void __launch_bounds__(kBlockThreads)
    pruning_kernel(DeviceView<const double> weighted_counts, DeviceView<const double> low_and_high,
                   DeviceView<float> scores) {
  const std::size_t i = element_index();
  if (i >= scores.size()) return;
  const double low = low_and_high[0], range = low_and_high[1] - low;
  scores[i] = range > 0 ? static_cast<float>((weighted_counts[i] - low) / range) : 0.0f;
}

}  // namespace

void importance_scores(std::span<const std::int64_t> counts, int views, std::span<std::int64_t> scores,
                       CudaStream& stream) {
  launch_each(stream, "importance_scores", importance_kernel, scores.size(), counts, static_cast<std::int64_t>(views),
              scores);
}

void pruning_scores(std::span<const double> weighted_counts, std::span<float> scores, CudaStream& stream) {
  if (scores.empty()) return;
  DeviceArray<double> range(stream);
  range.ensure(2);
  launch(stream, "range_of_scores", range_kernel, dim3(1), dim3(kBlockThreads), weighted_counts, range.span());
  launch_each(stream, "pruning_scores", pruning_kernel, scores.size(), weighted_counts,
              std::span<const double>(range.span()), scores);
}

void add_view(std::span<const std::int32_t> view_counts, double photometric_loss, std::span<std::int64_t> counts,
              std::span<double> weighted_counts, CudaStream& stream) {
  launch_each(stream, "add_view", add_view_kernel, counts.size(), view_counts, photometric_loss, counts,
              weighted_counts);
}

}  // namespace splatboost::cuda

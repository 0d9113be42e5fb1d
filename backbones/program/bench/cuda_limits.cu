// SPDX-License-Identifier: Apache-2.0
#include "program/bench/cuda_limits.h"

#include <cuda_runtime.h>

#include <algorithm>

#include "device/cuda_event.h"
#include "device/device_view.h"
#include "device/launch.h"
#include "splatboost/device_array.h"

namespace splatboost::program {
namespace {

constexpr int kRuns = 10;
constexpr int kChains = 8, kUnrolled = 16;

__global__ void __launch_bounds__(kBlockThreads) copy_kernel(DeviceView<const float4> from, DeviceView<float4> to) {
  const std::size_t i = element_index();
  if (i < to.size()) to[i] = from[i];
}

/// Independent chains hide the latency of a multiply-add. The sums are stored, so that the compiler keeps the work.
__global__ void __launch_bounds__(kBlockThreads) multiply_add_kernel(int rounds, float factor, DeviceView<float> sums) {
  const std::size_t i = element_index();
  if (i >= sums.size()) return;
  float chains[kChains];
#pragma unroll
  for (int c = 0; c < kChains; ++c) chains[c] = static_cast<float>(i) + 0.1f * static_cast<float>(c);
  const float rest = 1.0f - factor;
  for (int round = 0; round < rounds; ++round) {
#pragma unroll
    for (int k = 0; k < kUnrolled; ++k) {
#pragma unroll
      for (int c = 0; c < kChains; ++c) chains[c] = fmaf(chains[c], factor, rest);
    }
  }
  float sum = 0.0f;
#pragma unroll
  for (int c = 0; c < kChains; ++c) sum += chains[c];
  sums[i] = sum;
}

/// Seconds of the fastest run on the device.
template <class Run>
double best_of_runs(CudaStream& stream, const Run& run) {
  cuda::Event begin(stream, cudaEventDefault), end(stream, cudaEventDefault);
  double best = 0;
  for (int i = 0; i < kRuns; ++i) {
    begin.record();
    run();
    end.record();
    end.wait();
    const double seconds = seconds_between(begin, end);
    best = i == 0 ? seconds : std::min(best, seconds);
  }
  return best;
}

std::string version_text(int version) {  // 13000 is 13.0
  return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

}  // namespace

CudaDeviceFacts cuda_device_facts(const CudaStream& stream) {
  cudaDeviceProp properties{};
  int driver = 0, runtime = 0;
  stream.check(cudaGetDeviceProperties(&properties, stream.ordinal()), "cudaGetDeviceProperties");
  stream.check(cudaDriverGetVersion(&driver), "cudaDriverGetVersion");
  stream.check(cudaRuntimeGetVersion(&runtime), "cudaRuntimeGetVersion");
  return {properties.name, std::to_string(properties.major) + "." + std::to_string(properties.minor),
          version_text(driver), version_text(runtime), properties.totalGlobalMem};
}

MachineLimits measure_limits(CudaStream& stream, const CudaProbe& probe) {
  MachineLimits limits;
  {
    DeviceArray<float4> from(stream), to(stream);
    from.ensure(probe.copied_bytes / sizeof(float4));
    to.ensure(from.size());
    from.fill_zero();
    const double seconds = best_of_runs(stream, [&] {
      launch_each(stream, "copy", copy_kernel, to.size(), std::span<const float4>(from.span()), to.span());
    });
    limits.bytes_per_second = 2.0 * static_cast<double>(to.size() * sizeof(float4)) / seconds;
  }
  DeviceArray<float> sums(stream);
  sums.ensure(probe.threads);
  const double seconds = best_of_runs(stream, [&] {
    launch_each(stream, "multiply_add", multiply_add_kernel, sums.size(), probe.rounds, 0.999f, sums.span());
  });
  limits.operations_per_second =
      2.0 * kChains * kUnrolled * probe.rounds * static_cast<double>(probe.threads) / seconds;
  return limits;
}

}  // namespace splatboost::program
